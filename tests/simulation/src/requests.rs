//! The requests of clients, and a machine's answers: through the service itself, as if they came off the
//! wire.

use std::collections::BTreeMap;

use tonic::{Code, Request as Tonic, Response, Status};
use treewright_core::space::{Scale, Space};
use treewright_core::study::StudySpec;
use treewright_proto::convert::spec_to_wire;
use treewright_proto::v1::tuning_service_server::TuningService;
use treewright_proto::v1::{self as wire, outcome};
use treewright_server::convert::{from_proto, to_proto};
use treewright_server::error::Error;
use treewright_server::redirect::Redirect;
use treewright_server::tuning::{Reported, Tuning};

use crate::plan::{Bug, Plan};

pub(crate) const STUDY: &str = "studies/world";

#[derive(Clone, Debug)]
pub(crate) enum Request {
    Suggest(wire::SuggestRequest),
    Report(wire::ReportRequest),
    /// A frame of a Tune stream.
    Frame(wire::ReportRequest, wire::SuggestRequest),
    Abandon(String),
    Extend(String),
    GetTrial(String),
    Query(wire::QueryTrialsRequest),
    Best,
    Predict(BTreeMap<String, f64>),
    GetStudy,
    Update(Box<wire::UpdateStudyRequest>),
}

impl Request {
    pub(crate) fn trial(&self) -> Option<&str> {
        match self {
            Request::Report(report) | Request::Frame(report, _) => Some(&report.trial),
            Request::Abandon(name) | Request::Extend(name) | Request::GetTrial(name) => Some(name),
            _ => None,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) enum Answer {
    Trial(Box<wire::Trial>),
    Reported(Box<wire::ReportResponse>),
    /// The two halves of a frame.
    Frame(Result<Box<wire::ReportResponse>, Code>, Result<Box<wire::Trial>, Code>),
    Study(Box<wire::Study>),
    Trials(Vec<wire::Trial>),
    Other,
}

pub(crate) fn client_name(client: u32) -> String {
    format!("client-{client}")
}

/// Answers a request, and says where to try again what could not be done.
pub(crate) async fn answer(
    service: &impl TuningService,
    tuning: &Tuning,
    request: Request,
) -> (Result<Answer, Status>, Option<Redirect>) {
    if let Request::Frame(report, suggest) = request {
        return match frame(tuning, report, suggest).await {
            Ok((answer, redirect)) => (Ok(answer), redirect),
            Err(status) => (Err(status), None),
        };
    }
    let answer = single(service, request).await;
    let redirect =
        answer.as_ref().err().and_then(|status| Redirect::read(&status.metadata().clone().into_headers()));
    (answer, redirect)
}

async fn single(service: &impl TuningService, request: Request) -> Result<Answer, Status> {
    let inner = |response: Response<wire::Trial>| Answer::Trial(Box::new(response.into_inner()));
    Ok(match request {
        Request::Suggest(request) => inner(service.suggest(Tonic::new(request)).await?),
        Request::Report(request) => {
            Answer::Reported(Box::new(service.report(Tonic::new(request)).await?.into_inner()))
        }
        Request::Frame(..) => unreachable!("frames are answered apart"),
        Request::Abandon(trial) => {
            inner(service.abandon_trial(Tonic::new(wire::AbandonTrialRequest { trial })).await?)
        }
        Request::Extend(trial) => {
            inner(service.extend_lease(Tonic::new(wire::ExtendLeaseRequest { trial })).await?)
        }
        Request::GetTrial(trial) => {
            inner(service.get_trial(Tonic::new(wire::GetTrialRequest { name: trial })).await?)
        }
        Request::Query(request) => {
            Answer::Trials(service.query_trials(Tonic::new(request)).await?.into_inner().trials)
        }
        Request::Best => {
            let request = wire::GetBestRequest { study: STUDY.into(), ..Default::default() };
            match service.get_best(Tonic::new(request)).await {
                Err(status) if status.code() != Code::NotFound => return Err(status),
                _ => Answer::Other,
            }
        }
        Request::Predict(indicators) => {
            let request = wire::PredictRequest { study: STUDY.into(), indicators, ..Default::default() };
            service.predict(Tonic::new(request)).await?;
            Answer::Other
        }
        Request::GetStudy => {
            let request = wire::GetStudyRequest { name: STUDY.into() };
            Answer::Study(Box::new(service.get_study(Tonic::new(request)).await?.into_inner()))
        }
        Request::Update(request) => {
            service.update_study(Tonic::new(*request)).await?;
            Answer::Other
        }
    })
}

/// A frame of a Tune stream, without the stream.
async fn frame(
    tuning: &Tuning,
    report: wire::ReportRequest,
    suggest: wire::SuggestRequest,
) -> Result<(Answer, Option<Redirect>), Status> {
    let (report, suggest) = (from_proto::report(report)?, from_proto::suggest(suggest)?);
    let study = suggest.study.clone();
    let done = tuning.frame(Some(report), Some(suggest)).await;
    let redirect = done.redirect();
    let code = |error: Error| Status::from(error).code();
    let reported = done.reported.map_or(Err(Code::Internal), |reported| match reported {
        Ok(Reported::Taken(trial)) => Ok((to_proto::trial(&study, &*trial), false)),
        Ok(Reported::Duplicate(trial)) => Ok((to_proto::trial(&study, &*trial), true)),
        Err(error) => Err(code(error)),
    });
    let reported =
        reported.map(|(trial, duplicate)| Box::new(wire::ReportResponse { trial: Some(trial), duplicate }));
    let suggested = done.suggested.map_or(Err(Code::Internal), |suggested| match suggested {
        Ok(trial) => Ok(Box::new(to_proto::trial(&study, &trial))),
        Err(error) => Err(code(error)),
    });
    Ok((Answer::Frame(reported, suggested), redirect))
}

/// The study of a world: two numbers and a place.
pub(crate) fn study(plan: &Plan) -> wire::Study {
    let space = Space::builder().integer("leaf", 1..=64).default(8).float("cost", 0.0..=1.0).default(0.5);
    let spec = StudySpec::builder(space.build().expect("a space"))
        .indicator("place", 0.0..=1.0, Scale::Linear)
        .minimise("render_ms", 1.0)
        .seed(plan.seed);
    wire::Study {
        policy: Some(wire::Policy {
            epsilon: Some(0.7),
            search: if plan.default_policy { wire::SearchMethod::Auto } else { wire::SearchMethod::Random }
                .into(),
            predictor: if plan.default_policy {
                wire::PredictorMethod::Auto
            } else {
                wire::PredictorMethod::NearestNeighbour
            }
            .into(),
            trials_per_state: plan.trials_per_state,
            lease_s: plan.lease_s,
            regret_budget: plan.regret_budget.filter(|_| plan.bug != Some(Bug::Overspending)),
            // Who keeps no budget does not stop trials either.
            abort_above: (plan.bug == Some(Bug::Overspending)).then_some(1e6),
            ..wire::Policy::default()
        }),
        ..spec_to_wire(&spec.build().expect("a study"))
    }
}

/// A change of the study's policy: how much it explores, and whether it is frozen.
pub(crate) fn change(plan: &Plan, epsilon: f64, is_frozen: bool) -> Request {
    let mut study = study(plan);
    study.name = STUDY.into();
    if let Some(policy) = &mut study.policy {
        policy.epsilon = Some(epsilon);
        policy.operation = if is_frozen { wire::Operation::Freeze } else { wire::Operation::Tune }.into();
    }
    let paths = ["policy.epsilon", "policy.operation"].map(str::to_owned).to_vec();
    let update_mask = Some(prost_types::FieldMask { paths });
    Request::Update(Box::new(wire::UpdateStudyRequest { study: Some(study), update_mask }))
}

/// Whether a trial was handed out while the study was frozen: its result is not learnt from.
pub(crate) fn is_of_frozen(trial: &wire::Trial) -> bool {
    let explanation = trial.reason.as_ref().and_then(|reason| reason.explanation.as_ref());
    explanation.is_some_and(|explanation| explanation.silent)
}

/// A report that the configuration cannot be run.
pub(crate) fn infeasible(trial: &str) -> wire::ReportRequest {
    let kind = outcome::Kind::Infeasible(wire::Infeasible { reason: "too many leaves".into() });
    wire::ReportRequest {
        trial: trial.to_owned(),
        outcome: Some(wire::Outcome { kind: Some(kind) }),
        ..wire::ReportRequest::default()
    }
}

pub(crate) fn report(trial: &str, render_ms: f64, aborted: bool) -> wire::ReportRequest {
    let kind = if aborted {
        outcome::Kind::Aborted(wire::Aborted { lower_bound: render_ms })
    } else {
        outcome::Kind::Ok(wire::Ok {})
    };
    wire::ReportRequest {
        trial: trial.to_owned(),
        measurements: BTreeMap::from([("render_ms".to_owned(), render_ms)]),
        outcome: Some(wire::Outcome { kind: Some(kind) }),
        ..wire::ReportRequest::default()
    }
}
