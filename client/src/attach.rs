//! Additions to every call: the token, and a request id by which a line of this program's log finds the lines
//! of the daemon's.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::{Request, Status};

pub(crate) const REQUEST_ID: &str = "x-request-id";

/// Attaches token and request id to each call.
#[derive(Debug, Clone)]
pub(crate) struct Attach {
    bearer: Option<MetadataValue<Ascii>>,
    session: u64,
    calls: Arc<AtomicU64>,
}

impl Attach {
    pub(crate) fn new(bearer: Option<MetadataValue<Ascii>>, session: u64) -> Self {
        Self { bearer, session, calls: Arc::default() }
    }
}

impl Interceptor for Attach {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(bearer) = &self.bearer {
            request.metadata_mut().insert("authorization", bearer.clone());
        }
        let call = self.calls.fetch_add(1, Ordering::Relaxed);
        if let Ok(id) = MetadataValue::try_from(format!("{:016x}-{call:x}", self.session)) {
            request.metadata_mut().insert(REQUEST_ID, id);
        }
        Ok(request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_call_has_an_id_of_its_own() {
        let mut attach = Attach::new(None, 0xabc);
        let mut id = || {
            let request = attach.clone().call(Request::new(())).unwrap();
            assert!(attach.call(Request::new(())).is_ok());
            request.metadata().get(REQUEST_ID).unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!(id(), "0000000000000abc-0");
        assert_eq!(id(), "0000000000000abc-2");
    }
}
