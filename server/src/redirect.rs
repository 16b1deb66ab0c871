//! The place for another try of a request that failed here: the replica that holds its study, or this one.
//!
//! It travels beside the gRPC status as two headers, so that a forwarding replica can read it.

use tonic::metadata::MetadataMap;
use treewright_store::StoreError;

use crate::error::Error;

/// In an answer: the address of the replica that holds the study.
pub const HOLDER: &str = "treewright-holder";

/// In an answer: the study that is held elsewhere, or that was reloaded before the request was done.
pub const STUDY: &str = "treewright-study";

/// Why a request that failed here may succeed elsewhere, or later. Nothing of it was done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Redirect {
    /// Another replica holds the study.
    ToReplica {
        /// The study.
        study: String,
        /// That replica's address.
        address: String,
    },
    /// The study went to another replica during the request.
    Retry {
        /// The study.
        study: String,
    },
}

impl Redirect {
    /// The redirect of an error; none where it is final.
    pub fn of(error: &Error) -> Option<Self> {
        match error {
            Error::Store(StoreError::Elsewhere { study, address }) => {
                Some(Self::ToReplica { study: study.clone(), address: address.clone() })
            }
            Error::Store(StoreError::Fenced(study)) | Error::Reloading(study) => {
                Some(Self::Retry { study: study.clone() })
            }
            _ => None,
        }
    }

    /// Writes it beside the status of an answer.
    pub(crate) fn write(&self, metadata: &mut MetadataMap) {
        let (study, address) = match self {
            Self::ToReplica { study, address } => (study, Some(address)),
            Self::Retry { study } => (study, None),
        };
        // Ids of studies are plain characters; an address that is no header value cannot be used either.
        if let Ok(study) = study.parse() {
            metadata.insert(STUDY, study);
        }
        if let Some(Ok(address)) = address.map(|address| address.parse()) {
            metadata.insert(HOLDER, address);
        }
    }

    /// Reads it from the headers of an answer.
    pub fn read(headers: &http::HeaderMap) -> Option<Self> {
        let text = |name| headers.get(name)?.to_str().ok().map(str::to_owned);
        let study = text(STUDY)?;
        Some(match text(HOLDER) {
            Some(address) => Self::ToReplica { study, address },
            None => Self::Retry { study },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_redirect_survives_the_way_through_headers() {
        let study = "hall".to_owned();
        let address = "http://10.0.0.7:50611".to_owned();
        for redirect in [Redirect::ToReplica { study: study.clone(), address }, Redirect::Retry { study }] {
            let mut metadata = MetadataMap::new();
            redirect.write(&mut metadata);
            assert_eq!(Redirect::read(&metadata.into_headers()), Some(redirect));
        }
        assert_eq!(Redirect::read(&http::HeaderMap::new()), None);
    }
}
