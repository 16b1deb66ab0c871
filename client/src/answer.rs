//! Getting an answer within a deadline, by a single call or by a stream.
//!
//! An answer arrives through a one-shot channel that is made with the question. A caller whose deadline
//! passes keeps the channel; the next call for that state takes the answer from it. A channel without a use
//! is dropped with its answer, and a dropped suggestion gives its trial back. So a late answer is used or
//! given back, and cannot be taken for the answer to a later question.

use std::sync::Arc;
use std::time::SystemTime;

use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;
use tokio::time::Instant;

use crate::shared::{Shared, SuggestAnswer};
use crate::{ClientError, Indicators, Suggestion, checks};

/// A question that was asked and not answered in time.
#[derive(Debug)]
pub(crate) struct Outstanding {
    pub(crate) indicators: Indicators,
    pub(crate) answer: oneshot::Receiver<SuggestAnswer>,
}

/// Answers within the deadline: with the late answer to an earlier question about that state, with the answer
/// to a new question, or with the fallback.
///
/// `ask` sends the question. It is dropped, with everything that it holds, as soon as it is not needed.
pub(crate) async fn within_deadline(
    shared: &Arc<Shared>,
    outstanding: &mut Option<Outstanding>,
    indicators: &Indicators,
    ask: impl FnOnce() -> oneshot::Receiver<SuggestAnswer>,
) -> Suggestion {
    let limit = shared.context.core.options.deadline;
    let deadline = Instant::now() + limit;
    if let Err(problem) = checks::state(&shared.context.spec, indicators) {
        return shared.fall_back(indicators, Arc::new(problem));
    }
    let mut earlier = outstanding
        .take()
        .filter(|earlier| checks::are_one_state(&shared.context.spec, &earlier.indicators, indicators));
    if let Some(one) = &mut earlier {
        match one.answer.try_recv() {
            Ok(Ok(suggestion)) if suggestion.lease_is_live(SystemTime::now()) => {
                return shared.deliver(suggestion);
            }
            Ok(_) | Err(TryRecvError::Closed) => earlier = None,
            Err(TryRecvError::Empty) => {}
        }
    }
    if let Some(problem) = shared.problem() {
        *outstanding = earlier;
        return shared.fall_back(indicators, problem);
    }
    let mut question = match earlier {
        Some(earlier) => {
            drop(ask);
            earlier
        }
        None => Outstanding { indicators: indicators.clone(), answer: ask() },
    };
    match tokio::time::timeout_at(deadline, &mut question.answer).await {
        Ok(Ok(Ok(suggestion))) => shared.deliver(suggestion),
        Ok(Ok(Err(problem))) => shared.fall_back(indicators, Arc::new(problem)),
        Ok(Err(_closed)) => {
            let reason = "the connection ended before the answer came";
            shared.fall_back(indicators, Arc::new(ClientError::away(&shared.context.core.url, reason)))
        }
        Err(_elapsed) => {
            let problem = Arc::new(shared.context.core.late("Suggest", limit));
            shared.context.core.circuit_breaker.failure(Arc::clone(&problem));
            *outstanding = Some(question);
            shared.fall_back(indicators, problem)
        }
    }
}
