//! Trouble of a task that is done again and again: logged when it begins, rarely while it lasts, and once
//! when it is over.

use tokio::time::Instant;

use crate::limits;

/// Whether a task is in trouble, and when that was logged last.
#[derive(Debug, Default)]
pub(crate) struct Trouble {
    logged: Option<Instant>,
}

impl Trouble {
    /// Notes a failure. True where it is worth a line: the first one, and one each
    /// [`TROUBLE_PERIOD`](limits::TROUBLE_PERIOD).
    pub(crate) fn is_worth_a_line(&mut self) -> bool {
        let is_news = self.logged.is_none_or(|logged| logged.elapsed() >= limits::TROUBLE_PERIOD);
        if is_news {
            self.logged = Some(Instant::now());
        }
        is_news
    }

    /// Notes a success. True where the task was in trouble before.
    pub(crate) fn is_over(&mut self) -> bool {
        self.logged.take().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn lasting_trouble_is_logged_at_its_begin_rarely_and_at_its_end() {
        let mut trouble = Trouble::default();
        assert!(!trouble.is_over(), "nothing was wrong");
        let mut lines = 0;
        for _ in 0..3 * limits::TROUBLE_PERIOD.as_secs() {
            lines += u32::from(trouble.is_worth_a_line());
            tokio::time::advance(std::time::Duration::from_secs(1)).await;
        }
        assert_eq!(lines, 3);
        assert!(trouble.is_over() && !trouble.is_over(), "said once");
        assert!(trouble.is_worth_a_line(), "new trouble");
    }
}
