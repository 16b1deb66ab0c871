//! The end of an idle daemon: one that a command line started for its user ends by itself.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, MissedTickBehavior, interval};

use crate::metrics::Metrics;

/// The interval of the checks for requests.
const LOOK: Duration = Duration::from_millis(500);

/// Waits until there was no request for this time. A request counts when it is answered, and connected
/// clients ask now and then whether the daemon serves. Without a time it waits for ever.
pub(crate) async fn idle_for(time: Option<Duration>, metrics: Arc<Metrics>) {
    let Some(time) = time else { return std::future::pending().await };
    let (mut asked, mut since) = (metrics.answers(), Instant::now());
    let mut ticks = interval(LOOK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while since.elapsed() < time {
        ticks.tick().await;
        let now = metrics.answers();
        assert!(now >= asked, "{asked} answers have become {now}");
        if now != asked {
            (asked, since) = (now, Instant::now());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn silence_ends_it_and_questions_put_that_off() {
        let metrics = Arc::new(Metrics::new());
        let begin = Instant::now();
        let idle = tokio::spawn(idle_for(Some(Duration::from_secs(10)), Arc::clone(&metrics)));
        tokio::time::sleep(Duration::from_secs(8)).await;
        metrics.answered("Ping", tonic::Code::Ok, Duration::ZERO);
        idle.await.expect("it ends");
        let took = begin.elapsed();
        assert!(took >= Duration::from_secs(17) && took < Duration::from_secs(20), "{took:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn without_a_time_it_never_ends() {
        let idle = idle_for(None, Arc::new(Metrics::new()));
        assert!(tokio::time::timeout(Duration::from_secs(1_000_000), idle).await.is_err());
    }
}
