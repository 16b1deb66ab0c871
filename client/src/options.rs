//! Options of a client.

use std::time::Duration;

use treewright_model::limits::CLIENT_ID_CHARACTERS_MAX;

use crate::{ClientError, Credentials, Fingerprint, client_id, detect_fingerprint, limits};

/// Settings of a client; the defaults suit a renderer on the daemon's machine.
#[derive(Debug, Clone)]
pub struct Options {
    /// The client's name for the service: 1 to 128 printable characters, unique among the machines that work
    /// on a study. Trials that run side by side, in threads, tasks or processes of this machine, have workers
    /// with names of their own: `ID`, `ID#2`, `ID#3` and so on, up to [`limits::WORKERS`]. Default: program,
    /// machine, user and the first free slot among those that run at the same time. A restarted program gets
    /// that name again, and with it the unfinished trials; clients of one process share it.
    pub client_id: String,
    /// The machine and software, sent with every suggestion. Default: [`crate::detect_fingerprint`].
    pub fingerprint: Fingerprint,
    /// Token and certificates. Default: none.
    pub credentials: Credentials,
    /// The frame loop stops every trial no later than when its cost reaches
    /// [`crate::Suggestion::abort_above`], even within a frame. A regret budget then sets far less aside for
    /// each trial; where none is kept, trials are stopped at four times the best cost. Default false.
    pub can_abort: bool,
    /// Every trial runs at the level that [`crate::Suggestion::fidelity`] names, where the study has cheaper
    /// ones. Default false: all trials are full ones.
    pub fidelities: bool,
    /// Longest wait of a frame for a suggestion, connecting included. Default 50 ms.
    pub deadline: Duration,
    /// Longest time of any other call. Default 5 s.
    pub call_deadline: Duration,
    /// Most reports that may wait for the daemon, 1 to 1048576. Default 1024. When it is full, the oldest is
    /// dropped and counted: its lease is the likeliest to be gone, and the newest says most of the present.
    pub queue: usize,
    /// First pause after a failure; it doubles with each further one. Default 50 ms.
    pub back_off_min: Duration,
    /// Longest pause after a failure. Default 5 s.
    pub back_off_max: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            client_id: client_id::default_client_id(),
            fingerprint: detect_fingerprint(),
            credentials: Credentials::new(),
            can_abort: false,
            fidelities: false,
            deadline: Duration::from_millis(50),
            call_deadline: Duration::from_secs(5),
            queue: limits::DEFAULT_QUEUE,
            back_off_min: Duration::from_millis(50),
            back_off_max: Duration::from_secs(5),
        }
    }
}

impl Options {
    /// The defaults.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets who this is.
    #[must_use]
    pub fn client_id(mut self, client_id: impl Into<String>) -> Self {
        self.client_id = client_id.into();
        self
    }

    pub(crate) fn check(&self) -> Result<(), ClientError> {
        let characters = self.client_id.chars().count();
        if characters == 0
            || characters > CLIENT_ID_CHARACTERS_MAX
            || self.client_id.chars().any(char::is_control)
        {
            let problem = format!("it must have 1 to {CLIENT_ID_CHARACTERS_MAX} printable characters");
            return Err(ClientError::invalid("client id", problem));
        }
        if !(1..=limits::LARGEST_QUEUE).contains(&self.queue) {
            let problem = format!("{} is not within 1 to {}", self.queue, limits::LARGEST_QUEUE);
            return Err(ClientError::invalid("queue", problem));
        }
        if self.back_off_min.is_zero() || self.back_off_max < self.back_off_min {
            return Err(ClientError::invalid(
                "back-off",
                "the shortest must be above 0 and not above the longest",
            ));
        }
        Ok(())
    }
}

macro_rules! setters {
    ($($(#[$about:meta])+ $field:ident: $type:ty;)+) => {
        impl Options {
            $(
                $(#[$about])+
                #[must_use]
                pub fn $field(mut self, $field: $type) -> Self {
                    self.$field = $field;
                    self
                }
            )+
        }
    };
}

setters! {
    /// Sets the machine and software.
    fingerprint: Fingerprint;
    /// Sets token and certificates.
    credentials: Credentials;
    /// Promises that trials are stopped in time.
    can_abort: bool;
    /// Promises that trials run at the level that they name.
    fidelities: bool;
    /// Sets how long a suggestion may keep a frame waiting.
    deadline: Duration;
    /// Sets how long any other call may take.
    call_deadline: Duration;
    /// Sets how many reports may wait.
    queue: usize;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_checked() {
        assert!(Options::default().check().is_ok());
        assert!(Options::new().client_id("").check().is_err());
        assert!(Options::new().client_id("a\nb").check().is_err());
        assert!(Options::new().queue(0).check().is_err());
    }
}
