//! Taking a study: the replica that loads it holds it, unless another living replica does.

use std::time::Instant;

use sqlx::postgres::PgConnection;

use super::failed;
use super::shared::{SharedState, StudyHolder};
use super::statements as sql;
use crate::assembly::study_not_found;
use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::limits;
use crate::read::ask;

/// The number of tries of a claim while other replicas are quicker.
const TRIES: usize = 8;

/// Raises the study's epoch and makes this replica its owner. From then on, changes computed under an older
/// epoch are refused.
pub(super) async fn claim(connection: &mut PgConnection, shared: &SharedState, study: &str) -> Result<Fence> {
    for _ in 0..TRIES {
        let me = shared.me();
        let lapse_s = limits::REPLICA_LAPSE.as_secs_f64();
        let found: Option<(i64, i64, Option<i32>, Option<String>)> =
            ask!(query_as.fetch_optional(connection, sql::STUDY_OWNER, study, lapse_s))?;
        let (key, epoch, owner, address) = found.ok_or_else(|| study_not_found(study))?;
        if let (Some(replica), Some(address)) = (owner.filter(|owner| *owner != me), address) {
            let seen = Instant::now();
            shared.remember_owner(study, StudyHolder { key, replica, address: address.clone(), seen });
            return Err(StoreError::Elsewhere { study: study.to_owned(), address });
        }
        let claimed: Option<i64> =
            ask!(query_scalar.fetch_optional(connection, sql::STUDY_CLAIM, key, epoch, me))?;
        if let Some(claimed) = claimed {
            assert!(claimed > epoch, "the epoch of {study} goes from {epoch} to {claimed}");
            tracing::debug!(study, epoch = claimed, "claimed");
            let fence = Fence::of_epoch(study, key, claimed);
            shared.hold(fence.clone());
            return Ok(fence);
        }
    }
    Err(StoreError::Unavailable(format!("other replicas take study {study:?} again and again")))
}
