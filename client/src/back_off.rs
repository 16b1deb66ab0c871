//! Pauses between attempts. They double up to a limit. Half of each is left to chance, so that many clients
//! do not come back at one moment ("equal jitter", after M. Brooker, "Exponential Backoff And Jitter", AWS
//! Architecture Blog, 2015).

use std::time::Duration;

use crate::Options;

/// Shortest and longest pause.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BackOff {
    min: Duration,
    max: Duration,
}

impl BackOff {
    pub(crate) fn new(options: &Options) -> Self {
        Self { min: options.back_off_min, max: options.back_off_max }
    }

    /// Shortens the first pause to a sixteenth: where there are other addresses, one may well answer at once.
    pub(crate) fn sooner(self) -> Self {
        Self { min: self.min / 16, ..self }
    }

    /// The pause after `failures` failures in a row, with `chance` from 0 to 1.
    pub(crate) fn pause(self, failures: u32, chance: f64) -> Duration {
        let doublings = failures.saturating_sub(1).min(31);
        let whole = self.min.saturating_mul(1 << doublings).min(self.max);
        whole.mul_f64(0.5 + 0.5 * chance)
    }

    /// Waits for the pause after `failures` failures in a row, by chance.
    pub(crate) async fn sleep(self, failures: u32) {
        tokio::time::sleep(self.pause(failures, rand::random())).await;
    }

    /// Waits for that pause, and at least as long as the daemon asked for.
    pub(crate) async fn sleep_at_least(self, failures: u32, hint: Option<Duration>) {
        let pause = self.pause(failures, rand::random());
        // A tenth of chance on top, so that clients with equal hints do not come back together.
        let hint = hint.unwrap_or_default().mul_f64(1.0 + 0.1 * rand::random::<f64>());
        tokio::time::sleep(pause.max(hint)).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_the_limit_and_vary_by_half() {
        let ms = Duration::from_millis;
        let back_off = BackOff { min: ms(50), max: ms(1000) };
        let whole: Vec<_> = (1..=7).map(|failures| back_off.pause(failures, 1.0)).collect();
        assert_eq!(whole, [ms(50), ms(100), ms(200), ms(400), ms(800), ms(1000), ms(1000)]);
        assert_eq!(back_off.pause(3, 0.0), ms(100));
        assert_eq!(back_off.pause(u32::MAX, 1.0), ms(1000));
    }
}
