//! The stand-in's state: studies and trials, after the rules of the wire contract.

use std::collections::BTreeMap;
use std::time::SystemTime;

use tonic::{Code, Status};
use treewright_proto::v1::{self, TrialState, parameter::Domain};

/// The stand-in's memory, and the faults that it is to show.
#[derive(Debug, Default)]
pub struct Book {
    pub studies: BTreeMap<String, v1::Study>,
    pub trials: Vec<v1::Trial>,
    /// How often each call came in, health checks aside.
    pub calls: BTreeMap<&'static str, usize>,
    /// Reports that completed a trial. More than one for a trial would be a defect of the stand-in.
    pub stored_reports: Vec<String>,
    /// The number of next reports that are stored and whose answers are lost.
    pub lose_answers: usize,
    /// The number of next streamed requests after which the stream breaks instead of the answer.
    pub break_streams: usize,
    /// It says what only a newer daemon would say: modes, rules and outcomes of tomorrow.
    pub newer: bool,
    /// It knows no maximised metrics, no limits on measurements, and no trials of several frames.
    pub older: bool,
    /// The answer to Predict in place of the best that is known.
    pub predicted: Option<v1::PredictResponse>,
    /// The standing in answers to GetBest.
    pub standing: Option<v1::Standing>,
    /// Refusals to give, by call.
    pub refuse: BTreeMap<&'static str, Code>,
    /// The names under which studies were asked for trials, bests and predictions, one after the other.
    pub asked: Vec<String>,
    /// The end of leases, by a clock that may be behind; without one they are long.
    pub lease_end: Option<SystemTime>,
    /// The cost above which trials are to be stopped.
    pub abort_above: Option<f64>,
    /// The revisions of the space that questions for trials named, one after the other.
    pub revisions: Vec<u32>,
    /// The starts that questions for trials named, one after the other.
    pub starts: Vec<Option<v1::Configuration>>,
    /// The number of next questions about the study that meet a daemon that is still loading it.
    pub loading: usize,
}

impl Book {
    pub fn count(&self, call: &str) -> usize {
        self.calls.get(call).copied().unwrap_or(0)
    }

    pub fn in_state(&self, state: TrialState) -> usize {
        self.trials.iter().filter(|trial| trial.state() == state).count()
    }

    /// Counts a call and answers it at once where that is wished.
    pub fn enter(&mut self, call: &'static str) -> Result<(), Status> {
        *self.calls.entry(call).or_default() += 1;
        match self.refuse.get(call) {
            Some(code) => Err(Status::new(*code, format!("{call} is refused by the test"))),
            None => Ok(()),
        }
    }

    /// By its name, with or without its identity.
    pub fn study(&self, name: &str) -> Result<&v1::Study, Status> {
        let (plain, uid) = name.split_once('@').unwrap_or((name, ""));
        let found = match uid {
            "" => self.studies.get(plain),
            uid => self.studies.values().find(|study| study.uid == uid),
        };
        found.ok_or_else(|| Status::not_found(format!("{name} does not exist")))
    }

    pub fn create(&mut self, request: v1::CreateStudyRequest) -> Result<v1::Study, Status> {
        let name = format!("studies/{}", request.study_id);
        let mut study = request.study.ok_or_else(|| Status::invalid_argument("study: missing"))?;
        study.name.clone_from(&name);
        if self.older
            && let Some(objective) = &mut study.objective
        {
            objective.maximised.clear();
            objective.limits.clear();
            objective.episode_frames = 0;
        }
        study.space_revision = 1;
        study.create_time = Some(prost_types::Timestamp { seconds: 1_700_000_000, nanos: 0 });
        match self.studies.get(&name) {
            Some(stored) if *stored != named_like(stored, &study) => {
                Err(Status::already_exists(format!("{name} differs in the space")))
            }
            Some(stored) => Ok(stored.clone()),
            None => Ok(self.studies.entry(name).or_insert(study).clone()),
        }
    }

    pub fn suggest(&mut self, request: v1::SuggestRequest) -> Result<v1::Trial, Status> {
        self.revisions.push(request.space_revision);
        self.starts.push(request.start.clone());
        let wanted = request.wanted.is_some();
        let drawn = configuration(self.study(&request.study)?, self.trials.len());
        let configuration = request.wanted.unwrap_or(drawn);
        let held = self.trials.iter().find(|trial| {
            trial.state() == TrialState::Open
                && trial.client_id == request.client_id
                && trial.indicators == request.indicators
                && trial.name.starts_with(&request.study)
                && (!wanted || trial.configuration.as_ref() == Some(&configuration))
        });
        if let Some(trial) = held {
            return Ok(trial.clone());
        }
        let first = self.trials.is_empty();
        let trial = v1::Trial {
            name: format!("{}/trials/{}", request.study, self.trials.len() + 1),
            client_id: request.client_id,
            state_id: 1,
            indicators: request.indicators,
            configuration: Some(configuration),
            mode: match (wanted, first) {
                (true, _) => v1::Mode::Pinned,
                (false, true) => v1::Mode::Default,
                (false, false) => v1::Mode::Explore,
            }
            .into(),
            reason: Some(v1::Reason {
                summary: "by the stand-in".into(),
                source: "fake".into(),
                ..v1::Reason::default()
            }),
            lease_expire_time: Some(self.lease_end.map_or(
                prost_types::Timestamp { seconds: 32_000_000_000, nanos: 0 },
                prost_types::Timestamp::from,
            )),
            state: TrialState::Open.into(),
            fingerprint: request.fingerprint,
            origin: request.origin,
            abort_above: self.abort_above,
            ..v1::Trial::default()
        };
        let trial = if self.newer { of_tomorrow(trial) } else { trial };
        self.trials.push(trial.clone());
        Ok(trial)
    }

    pub fn report(&mut self, request: v1::ReportRequest) -> Result<v1::ReportResponse, Status> {
        let trial = find(&mut self.trials, &request.trial)?;
        let duplicate = match trial.state() {
            TrialState::Completed => true,
            TrialState::Abandoned => {
                return Err(Status::failed_precondition(format!("{} was given back", trial.name)));
            }
            _ => {
                trial.state = TrialState::Completed.into();
                let costs = ["render_ms", "front_cost"];
                trial.cost = costs.iter().find_map(|metric| request.measurements.get(*metric).copied());
                trial.measurements = request.measurements;
                trial.standard_errors = request.standard_errors;
                trial.outcome = request.outcome;
                self.stored_reports.push(request.trial);
                false
            }
        };
        Ok(v1::ReportResponse { trial: Some(trial.clone()), duplicate })
    }

    pub fn abandon(&mut self, name: &str) -> Result<v1::Trial, Status> {
        let trial = find(&mut self.trials, name)?;
        if trial.state() == TrialState::Completed {
            return Err(Status::failed_precondition(format!("{name} is completed")));
        }
        trial.state = TrialState::Abandoned.into();
        Ok(trial.clone())
    }

    pub fn extend(&mut self, name: &str) -> Result<v1::Trial, Status> {
        let trial = find(&mut self.trials, name)?;
        trial.lease_expire_time = Some(prost_types::Timestamp { seconds: 33_000_000_000, nanos: 0 });
        Ok(trial.clone())
    }

    /// Pages are two trials long, so that paging is met in every test. Knows one filter.
    pub fn query(&self, request: &v1::QueryTrialsRequest) -> Result<v1::QueryTrialsResponse, Status> {
        self.study(&request.study)?;
        let wanted = match request.filter.as_str() {
            // Nothing is carried over here, and every trial is of one state.
            "" | "state_id = 1" => None,
            "state = COMPLETED" => Some(TrialState::Completed),
            "state = OPEN" => Some(TrialState::Open),
            "mode = PINNED AND state = COMPLETED" => return Ok(v1::QueryTrialsResponse::default()),
            other => {
                return Err(Status::invalid_argument(format!(
                    "filter: `{other}` cannot be parsed at column 1"
                )));
            }
        };
        let begin: usize = request.page_token.parse().unwrap_or(0);
        let plain = |name: &str| name.split(['@', '/']).nth(1).map(str::to_owned);
        let of_study = plain(&request.study);
        let found = self.trials.iter().filter(|trial| plain(&trial.name) == of_study);
        let mut found: Vec<_> =
            found.filter(|trial| wanted.is_none_or(|state| trial.state() == state)).cloned().collect();
        if request.order_by == "number desc" {
            found.reverse();
        }
        let end = (begin + 2).min(found.len());
        let next_page_token = if end < found.len() { end.to_string() } else { String::new() };
        Ok(v1::QueryTrialsResponse { trials: found[begin..end].to_vec(), next_page_token })
    }

    pub fn best(&self, request: &v1::GetBestRequest) -> Result<v1::Best, Status> {
        self.study(&request.study)?;
        let measured = self.trials.iter().filter(|trial| trial.cost.is_some());
        let best = measured.min_by(|a, b| a.cost.partial_cmp(&b.cost).expect("costs are finite"));
        let best =
            best.ok_or_else(|| Status::not_found(format!("{}: nothing is measured yet", request.study)))?;
        Ok(v1::Best {
            configuration: best.configuration.clone(),
            cost: best.cost.unwrap_or_default(),
            default_cost: self.trials[0].cost,
            measurements: 1,
            state_id: 1,
            trial: best.name.clone(),
            last_measure_time: Some(prost_types::Timestamp { seconds: 1_700_000_001, nanos: 0 }),
            standing: self.standing,
        })
    }
}

/// A specification with the texts for people of a stored one, which are not compared.
fn named_like(stored: &v1::Study, study: &v1::Study) -> v1::Study {
    let v1::Study { display_name, note, tags, .. } = stored.clone();
    v1::Study { display_name, note, tags, ..study.clone() }
}

pub(super) fn find<'a>(trials: &'a mut [v1::Trial], name: &str) -> Result<&'a mut v1::Trial, Status> {
    let found = trials.iter_mut().find(|trial| trial.name == name);
    found.ok_or_else(|| Status::not_found(format!("{name} does not exist")))
}

/// The defaults, with the first integer moved on for each further trial so that configurations differ.
fn configuration(study: &v1::Study, number: usize) -> v1::Configuration {
    let mut moved = false;
    let parameters = study.space.iter().flat_map(|space| &space.parameters);
    let values = parameters.filter_map(|parameter| {
        let mut value = parameter.default_value.clone()?;
        if let (Some(Domain::Integer(_)), Some(v1::value::Kind::Integer(integer)), false) =
            (&parameter.domain, &mut value.kind, moved)
        {
            *integer += i64::try_from(number).expect("few trials");
            moved = true;
        }
        Some((parameter.name.clone(), value))
    });
    v1::Configuration { values: values.collect() }
}

/// The trial as a newer daemon might hand it out: with words that nobody knows yet.
fn of_tomorrow(trial: v1::Trial) -> v1::Trial {
    let explanation = Some(v1::Explanation { rule: 77, ..v1::Explanation::default() });
    let reason = trial.reason.map(|reason| v1::Reason { explanation, ..reason });
    v1::Trial { mode: 17, reason, ..trial }
}
