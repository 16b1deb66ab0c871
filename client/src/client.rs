//! The client: one connection, the studies on it, and all calls outside of frames.

use std::sync::Arc;
use std::time::{Duration, Instant};

use treewright_model::objective::Objective;
use treewright_proto::convert::{
    configuration_to_wire, fingerprint_to_wire, policy_to_wire, space_to_wire, spec_to_wire,
};
use treewright_proto::v1;

use crate::circuit_breaker::Status;
use crate::core::Core;
use crate::pages::{TrialPages, TrialQuery};
use crate::{
    Best, ChangedSpace, ClientError, Configuration, Fingerprint, Indicators, Options, PolicyChange,
    Prediction, Space, Stats, Study, StudyRecord, StudySpec, TextChange, TrialRecord, delivery, limits,
    local, wire,
};

/// A connection to the tuning service. Cheap to clone; clones share the connection, the outbox and the
/// counts.
///
/// Needs a tokio runtime; [`crate::blocking::Client`] does not. After the last handle is dropped, queued
/// reports are still sent for two seconds, as long as the runtime lives.
#[derive(Debug, Clone)]
pub struct Client {
    pub(crate) core: Arc<Core>,
    pub(crate) last_handle: Arc<LastHandle>,
}

/// Shared by the client and its studies; dropped with the last of them.
#[derive(Debug)]
pub(crate) struct LastHandle {
    core: Arc<Core>,
}

impl Drop for LastHandle {
    fn drop(&mut self) {
        // In the child of a fork it is the parent's.
        if self.core.is_of_this_process() {
            self.core.outbox.close();
        }
    }
}

impl Client {
    /// Makes a client of the daemon at `url`, e.g. `http://127.0.0.1:50611`, or `unix:/path/of/socket` on the
    /// daemon's machine. Where several daemons serve one database, `url` may name them all, parted by commas:
    /// the client uses the first that serves, and goes over to another by itself when that one goes. It
    /// begins to connect in the background and does not wait for that: an absent daemon is no error but shows
    /// in [`Client::status`].
    ///
    /// Errors: [`ClientError::BadUrl`]; [`ClientError::Invalid`] for an option out of range, and for
    /// credentials that need TLS where the address has none; [`ClientError::NoRuntime`] outside a tokio
    /// runtime.
    pub fn connect(url: &str, options: Options) -> Result<Self, ClientError> {
        let runtime = tokio::runtime::Handle::try_current()
            .map_err(|error| ClientError::NoRuntime { reason: error.to_string() })?;
        let core = Arc::new(Core::new(url, options)?);
        runtime.spawn(delivery::run(Arc::clone(&core)));
        let probing = Arc::clone(&core);
        let keep_awake = local::keep_awake_every(url);
        runtime.spawn(async move {
            let probe = || probing.look_for_daemon();
            tokio::select! {
                () = probing.circuit_breaker.keep_probing(probing.looking_back_off(), probe) => {}
                () = probing.keep_awake(keep_awake) => {}
                // Delivery ends at most so long after closing, and until then wants to know of the daemon's
                // return.
                () = async {
                    probing.outbox.closing().await;
                    tokio::time::sleep(limits::FLUSH_ON_DROP).await;
                } => {}
            }
        });
        let last_handle = Arc::new(LastHandle { core: Arc::clone(&core) });
        Ok(Self { core, last_handle })
    }

    /// Creates the study, or finds the equal one that is stored under this id.
    ///
    /// An absent daemon is no error: the study is then created in the background as soon as the daemon is
    /// there, and suggestions are fallbacks until then. A hanging one is waited for once, for
    /// [`Options::call_deadline`].
    ///
    /// Errors: [`ClientError::Refused`] when the daemon answers and will not have it, e.g. because the id is
    /// taken by a different specification; [`ClientError::Malformed`].
    pub async fn study(&self, id: &str, spec: StudySpec) -> Result<Study, ClientError> {
        let name = study_name(id);
        let found = match self.core.create_study(&name, &spec).await {
            Ok(record) => Some(record),
            Err(problem) if problem.is_unreachable() => {
                self.core.counters.note(&problem);
                None
            }
            Err(problem) => return Err(problem),
        };
        Ok(Study::new(&self.core, &self.last_handle, &name, spec, found.as_ref(), true))
    }

    /// A study that exists already. It is not created again when it is deleted meanwhile.
    ///
    /// Errors: [`ClientError::Refused`] when there is none; [`ClientError::Away`], [`ClientError::Late`].
    pub async fn existing_study(&self, id: &str) -> Result<Study, ClientError> {
        let record = self.core.study_record(&study_name(id)).await?;
        let spec = record.spec()?.clone();
        Ok(Study::new(&self.core, &self.last_handle, &record.name, spec, Some(&record), false))
    }

    /// The address the client was made with.
    pub fn url(&self) -> &str {
        &self.core.url
    }

    /// The machine and the software that it names with every question.
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.core.options.fingerprint
    }

    /// The state of the connection at the moment.
    pub fn status(&self) -> Status {
        self.core.circuit_breaker.status()
    }

    /// Counts of suggestions and reports so far.
    pub fn stats(&self) -> Stats {
        self.core.counters.snapshot(self.core.outbox.waiting())
    }

    /// Waits until every report is acknowledged or refused for good and every trial is given back.
    ///
    /// Errors: [`ClientError::Unflushed`] with the number of those still waiting when the time is up.
    pub async fn flush(&self, deadline: Duration) -> Result<(), ClientError> {
        self.core.flush(deadline).await
    }

    /// Asks the daemon whether it serves; returns how long the answer took.
    ///
    /// Errors: [`ClientError::Away`], [`ClientError::Late`].
    pub async fn ping(&self) -> Result<Duration, ClientError> {
        let start = Instant::now();
        self.core.probe(self.core.options.call_deadline).await?;
        Ok(start.elapsed())
    }

    /// All studies, by name. Errors: [`ClientError::Away`], [`ClientError::Late`],
    /// [`ClientError::Malformed`].
    pub async fn list_studies(&self) -> Result<Vec<StudyRecord>, ClientError> {
        let mut studies = Vec::new();
        let mut page_token = String::new();
        loop {
            let request = v1::ListStudiesRequest { page_size: limits::PAGE_SIZE, page_token };
            let answer = self.core.admin("ListStudies", self.core.rpc().list_studies(request)).await?;
            for study in answer.studies {
                studies.push(self.core.read_study("ListStudies", study)?);
            }
            page_token = answer.next_page_token;
            if page_token.is_empty() {
                return Ok(studies);
            }
        }
    }

    /// A stored study. Errors: [`ClientError::Refused`] when there is none; [`ClientError::Away`],
    /// [`ClientError::Late`].
    pub async fn get_study(&self, id: &str) -> Result<StudyRecord, ClientError> {
        self.core.study_record(&study_name(id)).await
    }

    /// Changes a stored study's policy, and nothing else.
    ///
    /// Errors: [`ClientError::Invalid`] for a change of nothing or out of range; [`ClientError::Refused`];
    /// [`ClientError::Away`], [`ClientError::Late`].
    pub async fn update_policy(&self, id: &str, change: &PolicyChange) -> Result<StudyRecord, ClientError> {
        change.set.check()?;
        let paths = change.paths();
        if paths.is_empty() {
            return Err(ClientError::invalid("policy", "nothing to change; name at least one field"));
        }
        let policy = policy_to_wire(change.values());
        let study = v1::Study { name: study_name(id), policy: Some(policy), ..v1::Study::default() };
        self.update_study(study, paths).await
    }

    /// Changes a stored study's texts for people, and nothing else.
    ///
    /// Errors: [`ClientError::Invalid`] for a change of nothing; [`ClientError::Refused`] for one beyond a
    /// limit, too; [`ClientError::Away`], [`ClientError::Late`].
    pub async fn update_texts(&self, id: &str, change: &TextChange) -> Result<StudyRecord, ClientError> {
        let TextChange { display_name, note, tags, added_tags, removed_tags } = change.clone();
        let given =
            [("display_name", display_name.is_some()), ("note", note.is_some()), ("tags", tags.is_some())];
        let mut paths: Vec<String> =
            given.iter().filter(|(_, is_given)| *is_given).map(|(path, _)| (*path).to_owned()).collect();
        paths.extend(added_tags.union(&removed_tags).map(|tag| format!("tags.{tag}")));
        if paths.is_empty() {
            return Err(ClientError::invalid("note", "nothing to change; give at least one text"));
        }
        let study = v1::Study {
            name: study_name(id),
            display_name: display_name.unwrap_or_default(),
            note: note.unwrap_or_default(),
            tags: tags
                .into_iter()
                .flatten()
                .chain(added_tags)
                .filter(|tag| !removed_tags.contains(tag))
                .collect(),
            ..v1::Study::default()
        };
        self.update_study(study, paths).await
    }

    async fn update_study(&self, study: v1::Study, paths: Vec<String>) -> Result<StudyRecord, ClientError> {
        let request = v1::UpdateStudyRequest {
            study: Some(study),
            update_mask: Some(prost_types::FieldMask { paths }),
        };
        let study = self.core.admin("UpdateStudy", self.core.rpc().update_study(request)).await?;
        self.core.read_study("UpdateStudy", study)
    }

    /// Creates a study, or finds the equal one that is stored under this id, and asks the daemon at once: an
    /// absent one is an error.
    ///
    /// Errors: [`ClientError::Refused`] when the id is taken by a different specification;
    /// [`ClientError::Away`], [`ClientError::Late`].
    pub async fn create_study(&self, id: &str, spec: &StudySpec) -> Result<StudyRecord, ClientError> {
        self.core.create_study(&study_name(id), spec).await
    }

    /// Gives a study another id. Its identity, trials and leases stay, and handles of it go on.
    ///
    /// Errors: [`ClientError::Refused`] when there is none, or the id is taken; [`ClientError::Away`],
    /// [`ClientError::Late`].
    pub async fn rename_study(&self, id: &str, to: &str) -> Result<StudyRecord, ClientError> {
        let request = v1::RenameStudyRequest { name: study_name(id), study_id: to.to_owned() };
        let study = self.core.admin("RenameStudy", self.core.rpc().rename_study(request)).await?;
        self.core.read_study("RenameStudy", study)
    }

    /// Changes the space of a study, which keeps its trials. `revision` is that of the space that is changed
    /// ([`StudyRecord::space_revision`]). `fixed` has values of parameters that are added or removed, where
    /// they are not the defaults. Of an added parameter it is the value of all trials before, of a removed
    /// one that of all trials from now on. With `only_try` nothing is changed, and the answer says what would
    /// be.
    ///
    /// Programs that work with the space of before go on, and are answered in it.
    /// Errors: [`ClientError::Refused`] when there is no such study, its space was changed meanwhile, or the
    /// new one is not acceptable; [`ClientError::Away`], [`ClientError::Late`].
    pub async fn change_space(
        &self,
        id: &str,
        revision: u32,
        space: &Space,
        fixed: &Configuration,
        only_try: bool,
    ) -> Result<ChangedSpace, ClientError> {
        let request = v1::ChangeSpaceRequest {
            name: study_name(id),
            revision,
            space: Some(space_to_wire(space)),
            fixed: configuration_to_wire(fixed.as_raw()).values,
            validate_only: only_try,
        };
        let answer = self.core.admin("ChangeSpace", self.core.rpc().change_space(request)).await?;
        Ok(ChangedSpace {
            study: self.core.read_study("ChangeSpace", answer.study.unwrap_or_default())?,
            kept_trials: answer.kept_trials,
            outside_trials: answer.outside_trials,
            given_back_trials: answer.given_back_trials,
        })
    }

    /// Deletes a study with its states, trials and models.
    ///
    /// A client that still works on a study that it specified itself creates it again.
    /// Errors: [`ClientError::Refused`] when there is none; [`ClientError::Away`], [`ClientError::Late`].
    pub async fn delete_study(&self, id: &str) -> Result<(), ClientError> {
        let request = v1::DeleteStudyRequest { name: study_name(id) };
        self.core.admin("DeleteStudy", self.core.rpc().delete_study(request)).await
    }

    /// Reads trials. Nothing is asked before the first [`TrialPages::next`].
    pub fn trials(&self, study: &str, query: TrialQuery) -> TrialPages {
        TrialPages::new(Arc::clone(&self.core), study_name(study), query)
    }

    /// See [`Study::predict`].
    ///
    /// Errors: [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub async fn predict(&self, study: &str, indicators: &Indicators) -> Result<Prediction, ClientError> {
        self.core.predict(&study_name(study), indicators, (0, None)).await
    }

    /// See [`Study::best`].
    ///
    /// Errors: [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub async fn best(&self, study: &str, indicators: &Indicators) -> Result<Best, ClientError> {
        let machine = Some(self.fingerprint());
        self.core.best(&study_name(study), indicators, machine, (0, None)).await
    }
}

/// Whether a daemon has kept the whole objective: one of before a field drops it without a word.
fn check_kept(name: &str, wanted: &Objective, stored: &Objective) -> Result<(), ClientError> {
    let has_limits = wanted.limits().iter().all(|limit| stored.limits().contains(limit));
    let dropped = if stored.maximised() != wanted.maximised() {
        format!("the daemon knows no maximised metrics, and its study {name} minimises them")
    } else if !has_limits || stored.limits().len() != wanted.limits().len() {
        format!("the daemon knows no limits on measurements, and its study {name} goes without")
    } else if stored.episode_frames() != wanted.episode_frames() {
        format!("the daemon knows no trials of several frames, and its study {name} has trials of one")
    } else {
        return Ok(());
    };
    let problem = format!("{dropped}: delete that study, and upgrade the daemon");
    Err(ClientError::invalid("objective", problem))
}

/// Takes an id or a whole resource name.
pub(crate) fn study_name(id: &str) -> String {
    if id.starts_with("studies/") { id.to_owned() } else { format!("studies/{id}") }
}

impl Core {
    /// A call that is not part of a frame.
    pub(crate) async fn admin<T>(
        &self,
        name: &'static str,
        rpc: impl Future<Output = Result<tonic::Response<T>, tonic::Status>>,
    ) -> Result<T, ClientError> {
        self.call(name, self.options.call_deadline, rpc).await
    }

    /// A call that only reads, and is repeated while the daemon is still loading the study. `rpc` begins it
    /// again.
    async fn read<T, F>(&self, name: &'static str, mut rpc: impl FnMut() -> F) -> Result<T, ClientError>
    where
        F: Future<Output = Result<tonic::Response<T>, tonic::Status>>,
    {
        let limit = self.options.call_deadline;
        self.until_ready(name, limit, || self.call(name, limit, rpc())).await
    }

    fn read_study(&self, call: &'static str, study: v1::Study) -> Result<StudyRecord, ClientError> {
        wire::study_from_wire(study).map_err(|problem| self.malformed(call, problem))
    }

    pub(crate) async fn create_study(
        &self,
        name: &str,
        spec: &StudySpec,
    ) -> Result<StudyRecord, ClientError> {
        let study_id = name.strip_prefix("studies/").unwrap_or(name).to_owned();
        let request = v1::CreateStudyRequest { study_id, study: Some(spec_to_wire(spec)) };
        let study = self.admin("CreateStudy", self.rpc().create_study(request)).await?;
        let record = self.read_study("CreateStudy", study)?;
        if let Ok(stored) = &record.spec {
            check_kept(name, &spec.objective, &stored.objective)?;
        }
        if !record.policy_differs.is_empty() {
            tracing::warn!(study = name, fields = ?record.policy_differs, "the stored policy differs and stays");
        }
        Ok(record)
    }

    pub(crate) async fn study_record(&self, name: &str) -> Result<StudyRecord, ClientError> {
        let rpc = || {
            let (mut rpc, request) = (self.rpc(), v1::GetStudyRequest { name: name.to_owned() });
            async move { rpc.get_study(request).await }
        };
        let study = self.read("GetStudy", rpc).await?;
        self.read_study("GetStudy", study)
    }

    pub(crate) async fn predict(
        &self,
        study: &str,
        indicators: &Indicators,
        (space_revision, start): (u32, Option<v1::Configuration>),
    ) -> Result<Prediction, ClientError> {
        let request = v1::PredictRequest {
            study: study.to_owned(),
            indicators: indicators.0.clone(),
            fingerprint: Some(fingerprint_to_wire(&self.options.fingerprint)),
            space_revision,
            start,
        };
        let rpc = || {
            let (mut rpc, request) = (self.rpc(), request.clone());
            async move { rpc.predict(request).await }
        };
        let prediction = self.read("Predict", rpc).await?;
        wire::prediction_from_wire(prediction).map_err(|problem| self.malformed("Predict", problem))
    }

    pub(crate) async fn best(
        &self,
        study: &str,
        indicators: &Indicators,
        machine: Option<&Fingerprint>,
        (space_revision, start): (u32, Option<v1::Configuration>),
    ) -> Result<Best, ClientError> {
        let request = v1::GetBestRequest {
            study: study.to_owned(),
            indicators: indicators.0.clone(),
            fingerprint: machine.map(fingerprint_to_wire),
            space_revision,
            start,
        };
        let rpc = || {
            let (mut rpc, request) = (self.rpc(), request.clone());
            async move { rpc.get_best(request).await }
        };
        let best = self.read("GetBest", rpc).await?;
        wire::best_from_wire(best).map_err(|problem| self.malformed("GetBest", problem))
    }

    pub(crate) async fn extend_lease(&self, trial: &str) -> Result<TrialRecord, ClientError> {
        let request = v1::ExtendLeaseRequest { trial: trial.to_owned() };
        let trial = self.admin("ExtendLease", self.rpc().extend_lease(request)).await?;
        self.read_trial("ExtendLease", trial)
    }
}
