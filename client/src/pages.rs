//! Reading a study's trials, page by page behind the scenes.

use std::collections::VecDeque;
use std::sync::Arc;

use treewright_proto::v1;

use crate::core::Core;
use crate::{ClientError, TrialRecord, limits, wire};

/// Which trials, and in which order. The default is all of them, by number.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TrialQuery {
    /// Comparisons joined by AND, e.g. `state = COMPLETED AND cost < 12.5`; the wire contract
    /// (`QueryTrialsRequest`) lists the fields. Empty is all.
    pub filter: String,
    /// `number`, `cost` or `measurement.NAME`, each with an optional ` desc`. Empty is `number`.
    pub order_by: String,
    /// Configurations as they are in the study's present space, without trials that are outside it.
    pub in_present_space: bool,
}

impl TrialQuery {
    /// All trials, by number.
    pub fn all() -> Self {
        Self::default()
    }

    /// Only the trials for which this holds.
    #[must_use]
    pub fn filter(mut self, filter: impl Into<String>) -> Self {
        self.filter = filter.into();
        self
    }

    /// With configurations of the study's present space, where that was changed. Trials outside it are left
    /// out. Otherwise each has the configuration that ran.
    #[must_use]
    pub fn in_present_space(mut self) -> Self {
        self.in_present_space = true;
        self
    }

    /// In this order.
    #[must_use]
    pub fn order_by(mut self, order: impl Into<String>) -> Self {
        self.order_by = order.into();
        self
    }
}

/// Trials one after the other; the next page is fetched when it is needed.
#[derive(Debug)]
pub struct TrialPages {
    core: Arc<Core>,
    request: v1::QueryTrialsRequest,
    page: VecDeque<v1::Trial>,
    last_page: bool,
}

impl TrialPages {
    pub(crate) fn new(core: Arc<Core>, study: String, query: TrialQuery) -> Self {
        let TrialQuery { filter, order_by, in_present_space } = query;
        let (page_size, page_token) = (limits::PAGE_SIZE, String::new());
        let request =
            v1::QueryTrialsRequest { study, filter, order_by, page_size, page_token, in_present_space };
        Self { core, request, page: VecDeque::new(), last_page: false }
    }

    /// The next trial; `None` after the last.
    ///
    /// Errors: [`ClientError::Refused`] when the filter or the order cannot be parsed or the study does not
    /// exist; [`ClientError::Away`], [`ClientError::Late`], [`ClientError::Malformed`].
    pub async fn next(&mut self) -> Result<Option<TrialRecord>, ClientError> {
        while self.page.is_empty() && !self.last_page {
            let answer =
                self.core.admin("QueryTrials", self.core.rpc().query_trials(self.request.clone())).await?;
            self.last_page = answer.next_page_token.is_empty();
            self.request.page_token = answer.next_page_token;
            self.page = answer.trials.into();
        }
        let trial = self.page.pop_front().map(wire::trial_from_wire).transpose();
        trial.map_err(|problem| self.core.malformed("QueryTrials", problem))
    }

    /// At most `limit` of the remaining trials. Errors: as for [`TrialPages::next`].
    pub async fn take(&mut self, limit: usize) -> Result<Vec<TrialRecord>, ClientError> {
        let mut trials = Vec::new();
        while trials.len() < limit {
            match self.next().await? {
                Some(trial) => trials.push(trial),
                None => break,
            }
        }
        Ok(trials)
    }
}
