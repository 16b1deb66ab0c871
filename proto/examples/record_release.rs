//! Records the messages of a released version, for the tests that compare later versions with it
//! (`proto/released/README.md`): the descriptors of its messages, and a conversation with its daemon.
//!
//! ```sh
//! treewrightd serve --listen 127.0.0.1:50700 --database /tmp/record.db &
//! cargo run -p treewright-proto --example record_release -- http://127.0.0.1:50700 proto/released/0.2.0
//! ```

use std::path::{Path, PathBuf};

use prost::Message;
use prost_types::{FieldMask, FileDescriptorSet};
use tonic::transport::Channel;
use treewright_model::assignment::Assignment;
use treewright_model::policy::{Operation, PolicySettings, PredictorMethod, SearchMethod};
use treewright_model::space::{Scale, Space};
use treewright_model::study::StudySpec;
use treewright_proto::convert::{configuration_to_wire, spec_to_wire};
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as wire, outcome};

type Failure = Box<dyn std::error::Error>;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let (Some(url), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: record_release URL FOLDER".into());
    };
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join("descriptors.binpb"), descriptors()?)?;
    let client = TuningServiceClient::connect(url).await?;
    Recorder { client, folder, calls: 0 }.converse().await
}

/// Without comments and places in the source, which no test compares.
fn descriptors() -> Result<Vec<u8>, Failure> {
    let mut all = FileDescriptorSet::decode(treewright_proto::FILE_DESCRIPTOR_SET)?;
    all.file.retain(|file| file.package() == "treewright.v1");
    for file in &mut all.file {
        file.source_code_info = None;
    }
    Ok(all.encode_to_vec())
}

struct Recorder {
    client: TuningServiceClient<Channel>,
    folder: PathBuf,
    calls: usize,
}

/// Calls an RPC and keeps request and response under its name and the number of the call.
macro_rules! call {
    ($recorder:expr, $name:literal, $method:ident, $request:expr) => {{
        let request = $request;
        $recorder.calls += 1;
        let stem = $recorder.folder.join(format!("{:02}.{}", $recorder.calls, $name));
        write(&stem, "request", &request)?;
        let response = $recorder.client.$method(request).await?.into_inner();
        write(&stem, "response", &response)?;
        response
    }};
}

fn write(stem: &Path, side: &str, message: &impl Message) -> Result<(), Failure> {
    let name = format!("{}.{side}.binpb", stem.display());
    Ok(std::fs::write(name, message.encode_to_vec())?)
}

impl Recorder {
    async fn converse(mut self) -> Result<(), Failure> {
        let study_id = "recorded".to_owned();
        let study = Some(study()?);
        call!(self, "CreateStudy", create_study, wire::CreateStudyRequest { study_id, study });
        let ends = [
            outcome::Kind::Ok(wire::Ok {}),
            outcome::Kind::Infeasible(wire::Infeasible { reason: "too deep".to_owned() }),
            outcome::Kind::Failed(wire::Failed { reason: "interrupted".to_owned() }),
            outcome::Kind::Aborted(wire::Aborted { lower_bound: 90.0 }),
            outcome::Kind::Ok(wire::Ok {}),
        ];
        for (index, kind) in ends.into_iter().enumerate() {
            let trial = call!(self, "Suggest", suggest, suggest(None));
            let ok = matches!(kind, outcome::Kind::Ok(_));
            let measured = [("build_ms", 3.0), ("render_ms", 10.0 + index as f64)];
            let measured = measured.map(|(name, value)| (name.to_owned(), value));
            let measurements = if ok { measured.into() } else { Default::default() };
            let outcome = Some(wire::Outcome { kind: Some(kind) });
            call!(
                self,
                "Report",
                report,
                wire::ReportRequest { trial: trial.name, measurements, outcome, ..Default::default() }
            );
        }
        let policy = wire::Policy { epsilon: Some(0.5), lease_s: 30, ..wire::Policy::default() };
        let study = wire::Study { name: STUDY.to_owned(), policy: Some(policy), ..wire::Study::default() };
        let paths = ["policy.epsilon", "policy.lease_s", "policy.regret_budget"].map(str::to_owned).to_vec();
        let update = wire::UpdateStudyRequest { study: Some(study), update_mask: Some(FieldMask { paths }) };
        call!(self, "UpdateStudy", update_study, update);
        let wanted = Assignment::new().with("min_leaf", 2).with("max_leaf", 4).with("bins", 16);
        let wanted = wanted.with("split", "sah").with("cost", 1.5).with("compact", true);
        let wanted = Some(configuration_to_wire(wanted.as_raw()));
        let trial = call!(self, "Suggest", suggest, suggest(wanted)).name;
        call!(self, "ExtendLease", extend_lease, wire::ExtendLeaseRequest { trial: trial.clone() });
        call!(self, "GetTrial", get_trial, wire::GetTrialRequest { name: trial.clone() });
        call!(self, "AbandonTrial", abandon_trial, wire::AbandonTrialRequest { trial });
        let study = STUDY.to_owned();
        let predict =
            wire::PredictRequest { study: study.clone(), indicators: indicators(), ..Default::default() };
        call!(self, "Predict", predict, predict);
        let best =
            wire::GetBestRequest { study: study.clone(), indicators: indicators(), ..Default::default() };
        call!(self, "GetBest", get_best, best);
        call!(self, "GetStudy", get_study, wire::GetStudyRequest { name: study.clone() });
        call!(self, "ListStudies", list_studies, wire::ListStudiesRequest::default());
        let filter = "state = COMPLETED AND mode != PINNED".to_owned();
        let query = wire::QueryTrialsRequest { study, filter, ..wire::QueryTrialsRequest::default() };
        call!(self, "QueryTrials", query_trials, query);
        Ok(())
    }
}

const STUDY: &str = "studies/recorded";

fn indicators() -> std::collections::BTreeMap<String, f64> {
    [("triangles".to_owned(), 262_267.0), ("distance".to_owned(), 12.5)].into()
}

fn suggest(wanted: Option<wire::Configuration>) -> wire::SuggestRequest {
    let software = [("embree".to_owned(), "4.4.0".to_owned())].into();
    let (cpu_model, isa) = ("a processor".to_owned(), "avx2".to_owned());
    let machine = wire::Fingerprint { cpu_model, isa, threads: 8, software };
    wire::SuggestRequest {
        study: STUDY.to_owned(),
        client_id: "recorder".to_owned(),
        indicators: indicators(),
        fingerprint: Some(machine),
        wanted,
        session: 7,
        can_abort: true,
        session_policy: None,
        origin: String::new(),
        reports_waiting: 3,
        fidelities: false,
        space_revision: 1,
        start: None,
    }
}

/// A study with every kind of domain, condition, constraint and indicator.
fn study() -> Result<wire::Study, Failure> {
    let space = Space::builder()
        .categorical("split", ["sah", "median"])
        .default("sah")
        .integer("min_leaf", 1..=32)
        .default(1)
        .log()
        .integer("max_leaf", 1..=32)
        .default(8)
        .log()
        .float("cost", 0.5..=4.0)
        .default(1.0)
        .boolean("compact")
        .default(false)
        .integer("bins", 4..=64)
        .default(16)
        .active_if("split", ["sah"])
        .less_or_equal("min_leaf", "max_leaf")
        .build()?;
    let policy = PolicySettings::new()
        .epsilon(1.0)
        .search(SearchMethod::NelderMead)
        .predictor(PredictorMethod::Contextual)
        .trials_per_state(40)
        .replicates(1)
        .epsilon_halves_after(100)
        .regret_budget(0.9)
        .abort_above(3.0)
        .worst_factor(50.0)
        .operation(Operation::Tune)
        .roll_back(true);
    let study = StudySpec::builder(space)
        .display_name("as recorded")
        .indicator("triangles", 0.0..=1e8, Scale::Log)
        .indicator("distance", 0.0..=100.0, Scale::Linear)
        .minimise("build_ms", 0.25)
        .minimise("render_ms", 1.0)
        .state_tolerance(0.02)
        .policy(policy)
        .seed(11)
        .build()?;
    Ok(spec_to_wire(&study))
}
