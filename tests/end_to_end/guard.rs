//! Helpers of the tests of TLS and tokens: an authority that issues certificates, callers that show tokens.

use std::time::{Duration, Instant};

use tonic::metadata::MetadataValue;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Channel;
use tonic::{Request, Status};
use treewright_proto::v1 as pb;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;

pub(crate) type Caller = TuningServiceClient<InterceptedService<Channel, Show>>;

/// Shows a token with every request.
#[derive(Clone)]
pub(crate) struct Show(Option<String>);

impl tonic::service::Interceptor for Show {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = &self.0 {
            let value = MetadataValue::try_from(format!("Bearer {token}")).expect("a header");
            request.metadata_mut().insert("authorization", value);
        }
        Ok(request)
    }
}

/// An authority, with a certificate for the daemon and one for clients.
pub(crate) struct Authority {
    issuer: rcgen::Issuer<'static, rcgen::KeyPair>,
    pub(crate) pem: String,
}

impl Authority {
    pub(crate) fn new() -> Self {
        let key = rcgen::KeyPair::generate().expect("a key");
        let mut parameters = rcgen::CertificateParams::new(Vec::new()).expect("parameters");
        parameters.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
        let pem = parameters.self_signed(&key).expect("a certificate").pem();
        Self { issuer: rcgen::Issuer::new(parameters, key), pem }
    }

    /// Certificate and key in PEM.
    pub(crate) fn issue(&self, name: &str) -> (String, String) {
        let key = rcgen::KeyPair::generate().expect("a key");
        let parameters = rcgen::CertificateParams::new(vec![name.to_owned()]).expect("parameters");
        (parameters.signed_by(&key, &self.issuer).expect("a certificate").pem(), key.serialize_pem())
    }
}

/// A caller that shows a token, if there is one.
pub(crate) fn caller(channel: Channel, token: Option<&str>) -> Caller {
    TuningServiceClient::with_interceptor(channel, Show(token.map(str::to_owned)))
}

/// Waits until the daemon knows the caller's token.
pub(crate) async fn in_force(caller: &mut Caller) {
    let list = pb::ListStudiesRequest::default;
    until("the token comes into force", async || caller.list_studies(list()).await, Result::is_ok).await;
}

/// Waits until a call comes out as it should; the daemon follows changes of tokens by itself, at once.
pub(crate) async fn until<T>(
    what: &str,
    mut call: impl AsyncFnMut() -> Result<T, Status>,
    good: impl Fn(&Result<T, Status>) -> bool,
) {
    let patience = Instant::now() + Duration::from_secs(20);
    loop {
        let answer = call().await;
        if good(&answer) {
            return;
        }
        assert!(Instant::now() < patience, "{what}: {:?}", answer.err());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}
