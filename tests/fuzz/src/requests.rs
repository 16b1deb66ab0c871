//! Any bytes as any request, through the service with a study behind it: no request panics, and none is
//! refused with INTERNAL.

use std::cell::RefCell;
use std::sync::Arc;

use crate::example;
use prost::Message;
use tokio::runtime::{Builder, Runtime};
use tonic::{Code, Request, Status};
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_server::TuningService;
use treewright_server::admission::Admission;
use treewright_server::clock::ManualClock;
use treewright_server::rpc::Service;
use treewright_server::tuning::Tuning;
use treewright_store::MemoryStore;

/// Number of requests for which a service is used; then it has grown enough.
const REQUESTS: u32 = 2_000;

struct Bench {
    runtime: Runtime,
    service: Service,
    left: u32,
}

impl Bench {
    fn new() -> Self {
        let runtime = Builder::new_current_thread().enable_time().build().expect("a runtime");
        let clock = Arc::new(ManualClock::at(1_750_000_000_000));
        let tuning = Arc::new(Tuning::new(Arc::new(MemoryStore::new()), clock));
        let service = Service::new(tuning, Admission::default());
        let study = wire::CreateStudyRequest { study_id: "s".into(), study: Some(example::study()) };
        runtime.block_on(service.create_study(Request::new(study))).expect("a valid study");
        let ask = example::suggest("c");
        runtime.block_on(service.suggest(Request::new(ask))).expect("a valid question");
        Bench { runtime, service, left: REQUESTS }
    }
}

thread_local! {
    static BENCH: RefCell<Option<Bench>> = const { RefCell::new(None) };
}

fn decode<M: Message + Default>(bytes: &[u8]) -> Option<Request<M>> {
    M::decode(bytes).ok().map(Request::new)
}

/// The RPCs with their functions, each of which is called with the message that the bytes are.
macro_rules! rpcs {
    ($($kind:ident: $call:ident,)*) => {
        /// The RPCs, by the byte that chooses one. New ones stand at the end: the corpus has these bytes.
        #[derive(Clone, Copy)]
        enum Kind {
            $($kind,)*
        }

        const KINDS: &[Kind] = &[$(Kind::$kind,)*];

        async fn send(service: &Service, kind: Kind, bytes: &[u8]) -> Option<Result<(), Status>> {
            Some(match kind {
                $(Kind::$kind => service.$call(decode(bytes)?).await.map(drop),)*
            })
        }
    };
}

rpcs! {
    CreateStudy: create_study, GetStudy: get_study, ListStudies: list_studies, UpdateStudy: update_study,
    DeleteStudy: delete_study, Suggest: suggest, Report: report, Predict: predict,
    AbandonTrial: abandon_trial, ExtendLease: extend_lease, QueryTrials: query_trials, GetBest: get_best,
    GetTrial: get_trial, RenameStudy: rename_study, ChangeSpace: change_space, ExcludeTrial: exclude_trial,
}

/// Sends a request: a byte that says which, and its message.
pub fn run(bytes: &[u8]) {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let kind = KINDS[usize::from(kind) % KINDS.len()];
    BENCH.with_borrow_mut(|bench| {
        let current = bench.get_or_insert_with(Bench::new);
        let answer = current.runtime.block_on(send(&current.service, kind, bytes));
        if let Some(Err(status)) = answer {
            assert_ne!(status.code(), Code::Internal, "{status}");
        }
        current.left -= 1;
        if current.left == 0 {
            *bench = None;
        }
    });
}
