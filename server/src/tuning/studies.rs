//! Use cases of a study: create, read, list, change its policy and texts, delete, and end leases everywhere.

use std::collections::BTreeMap;

use treewright_core::study::StudySpec;
use treewright_store::{Created, StoreError, StudyRecord};

use super::Tuning;
use crate::convert::names::StudyName;
use crate::convert::study_update::StudyUpdate;
use crate::error::{Error, Result};

impl Tuning {
    /// Creates a study, or finds an equal one.
    pub async fn create_study(&self, id: &str, spec: &StudySpec) -> Result<Created> {
        let created = self.store().create_study(id, spec, self.now_ms()).await?;
        assert_eq!(created.study.id, id, "another study was created");
        if created.is_new {
            let (parameters, indicators) =
                (spec.space.parameters().len(), spec.indicators.indicators().len());
            tracing::info!(study = id, parameters, indicators, "study created");
        }
        Ok(created)
    }

    /// The study that a request names. If the request gives an identity, it is the study of that identity,
    /// under its present id. Else it is the one of that id, which need not exist.
    ///
    /// # Errors
    /// [`Error::Replaced`] where the id is that of another study, and when the store cannot be read.
    pub async fn find(&self, name: StudyName) -> Result<StudyName> {
        let Some(uid) = name.uid else {
            return Ok(name);
        };
        if self.uid_in_memory(&name.id) == Some(uid) {
            return Ok(name);
        }
        match self.store().find_study(uid).await? {
            Some(id) => Ok(StudyName { id, uid: Some(uid) }),
            None => {
                // If no study has the id, that error is the answer.
                let other = self.store().get_study(&name.id).await?;
                Err(Error::Replaced(other.id))
            }
        }
    }

    /// Checks, after a read by its id, that a study that is named by its identity still has that id.
    ///
    /// # Errors
    /// Those of [`find`](Self::find); [`Error::Reloading`] where it has another id now.
    pub async fn is_still(&self, study: &StudyName) -> Result<()> {
        match self.find(study.clone()).await? {
            found if found == *study => Ok(()),
            found => Err(Error::Reloading(found.id)),
        }
    }

    /// Gives a study another id.
    pub async fn rename_study(&self, study: &StudyName, to: &str) -> Result<StudyRecord> {
        let renamed = self.store().rename_study(&study.id, study.uid, to).await?;
        assert_eq!(renamed.id, to, "{study} has got another name");
        self.forget(&study.id);
        tracing::info!(study = study.id, to, "study renamed");
        Ok(renamed)
    }

    /// Reads a study.
    pub async fn get_study(&self, study: &str) -> Result<StudyRecord> {
        let record = self.store().get_study(study).await?;
        assert_eq!(record.id, study, "another study was read");
        Ok(record)
    }

    /// Reads studies by rising id, behind `after`.
    pub async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>> {
        Ok(self.store().list_studies(after, size).await?)
    }

    /// Changes a study's policy, which holds from the next suggestion on, and its texts for people.
    pub async fn update_study(&self, study: &StudyName, update: &StudyUpdate) -> Result<StudyRecord> {
        let receipt = self
            .with_tuner(&study.id, |live, store, _| {
                // The name may have gone to another study meanwhile.
                live.is_meant(study)?;
                let spec = update.apply(live.tuner.spec())?;
                let policy_set = live.tuner.set_policy(spec.policy.clone());
                live.is_stale = policy_set.map_err(|error| Error::invalid("study", error))?;
                live.tuner.set_texts(&spec);
                debug_assert_eq!(**live.tuner.spec(), spec, "one study decides and another is stored");
                let models_since = live.tuner.knowledge().models_since();
                Ok::<_, Error>(store.update_study(live.fence(), &spec, &live.earlier, models_since))
            })
            .await??;
        self.metrics().durable(receipt).await?;
        tracing::info!(study = study.id, "study changed");
        let study = self.find(study.clone()).await?;
        self.get_study(&study.id).await
    }

    /// Deletes a study with all its data.
    pub async fn delete_study(&self, study: &StudyName) -> Result<()> {
        self.store().delete_study(&study.id, study.uid).await?;
        self.forget(&study.id);
        tracing::info!(study = study.id, "study deleted");
        Ok(())
    }

    /// Ends the leases that have run out, in every study. To be called now and then; a request for a study
    /// also ends that study's leases.
    ///
    /// # Errors
    /// The first error that does not pass by itself; the other studies are still swept.
    pub async fn sweep_leases(&self) -> Result<()> {
        self.sweep().await?.into_values().next().map_or(Ok(()), Err)
    }

    /// [Sweeps](Self::sweep_leases), and returns the errors that do not pass by themselves, by study.
    ///
    /// # Errors
    /// When the store does not list the leases that have run out.
    pub async fn sweep(&self) -> Result<BTreeMap<String, Error>> {
        let now_ms = self.now_ms();
        let due = self.store().studies_with_due_leases(now_ms).await?;
        self.environment.presence.swept(now_ms);
        let mut failed = BTreeMap::new();
        for study in due {
            let swept = self.with_tuner(&study, |live, store, _| live.commit(store, &[])).await;
            let swept = match swept {
                Ok(receipt) => self.metrics().durable(receipt).await.map_err(Error::from),
                Err(error) => Err(error),
            };
            match swept {
                Err(error) if passes(&error) => tracing::debug!(study, %error, "swept by another or later"),
                Err(error) => drop(failed.insert(study, error)),
                Ok(()) => {}
            }
        }
        Ok(failed)
    }
}

/// Whether a sweep may leave a study alone: it is being loaded, it went to another replica, which sweeps it,
/// or it is gone.
fn passes(error: &Error) -> bool {
    use StoreError::{Elsewhere, Fenced, StudyNotFound};
    match error {
        Error::Loading { .. } | Error::Reloading { .. } => true,
        Error::Store(error) => matches!(error, Elsewhere { .. } | Fenced { .. } | StudyNotFound { .. }),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use treewright_core::trial::{Trial, TrialState};
    use treewright_core::tuner::Change;
    use treewright_proto::v1;
    use treewright_store::{MemoryStore, Store as _};

    use super::super::checkpoints::tests::{spec, suggested};
    use super::*;
    use crate::clock::ManualClock;
    use crate::convert::names::TrialName;

    #[tokio::test]
    async fn who_names_an_identity_changes_no_study_that_got_the_name_meanwhile() {
        let tuning = Tuning::new(Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)));
        let uid = tuning.create_study("hall", &spec()).await.expect("created").study.uid;
        tuning.rename_study(&"hall".into(), "attic").await.expect("renamed");
        let namesake = tuning.create_study("hall", &spec()).await.expect("created").study;
        let meant = StudyName { id: "hall".to_owned(), uid: Some(uid) };
        let update = StudyUpdate::read(v1::Study::default(), None).expect("valid");
        let refused = tuning.update_study(&meant, &update).await.expect_err("it is another's");
        assert_eq!(refused, Error::Replaced("hall".to_owned()));
        tuning.rename_study(&meant, "loft").await.expect_err("it is another's");
        tuning.delete_study(&meant).await.expect_err("it is another's");
        assert_eq!(tuning.get_study("hall").await.expect("there"), namesake);
    }

    /// A study of which the database holds a trial in a state that does not exist.
    #[tokio::test]
    async fn a_sweep_names_the_study_that_fails_and_goes_on_with_the_others() {
        let (store, clock) = (Arc::new(MemoryStore::new()), Arc::new(ManualClock::at(1_000)));
        let tuning = Tuning::new(Arc::clone(&store) as _, Arc::clone(&clock) as _);
        tuning.create_study("attic", &spec()).await.expect("created");
        tuning.create_study("hall", &spec()).await.expect("created");
        let trial = suggested(&tuning, "one", 0.5).await;
        let fence = store.load("attic").await.expect("loaded").fence;
        let misplaced = Change { trials: vec![Trial { state_id: 99, ..trial }], ..Change::default() };
        store.commit(&fence, &[misplaced]).durable().await.expect("stored");
        clock.advance_ms(3_600_000);
        let failed = tuning.sweep().await.expect("swept");
        assert_eq!(failed.keys().collect::<Vec<_>>(), ["attic"]);
        assert!(failed["attic"].to_string().contains("attic"), "{failed:?}");
        let number = 1;
        let swept = tuning.get_trial(&TrialName { study: "hall".into(), number }).await.expect("there");
        assert_eq!(swept.state, TrialState::Expired);
        tuning.sweep_leases().await.expect_err("attic still fails");
    }

    #[test]
    fn a_sweep_fails_only_where_somebody_has_to_act() {
        let study = || "hall".to_owned();
        let address = "http://10.0.0.7:50611".to_owned();
        for error in [
            Error::Loading(study()),
            Error::Reloading(study()),
            StoreError::Elsewhere { study: study(), address }.into(),
            StoreError::Fenced(study()).into(),
            StoreError::StudyNotFound(study()).into(),
        ] {
            assert!(passes(&error), "{error}");
        }
        for error in [
            StoreError::Unavailable(String::new()).into(),
            StoreError::Inconsistent { study: None, problem: String::new() }.into(),
            StoreError::Closed.into(),
            Error::Defect("loading a study panicked"),
        ] {
            assert!(!passes(&error), "{error}");
        }
    }
}
