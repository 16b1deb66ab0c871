//! Changes of a study's policy from its pages, for visitors with the needed scope.
//!
//! A form that another site sends in a browser's name changes nothing: browsers do not send the cookie with
//! it, and a form has to come from a page of this port ([`is_own_form`]).

use http::{HeaderMap, header};
use prost_types::FieldMask;
use treewright_core::policy::{PolicyChange, PolicySettings};
use treewright_proto::convert::policy_to_wire;
use treewright_proto::v1;

use super::Visitor;
use super::query::Query;
use crate::access::caller::Caller;
use crate::error::Error;
use crate::rpc;
use treewright_store::tokens::Scope;

/// Whether the caller may change studies here. Without tokens nobody may: a proxy in front of the pages would
/// let all its readers change studies.
pub(super) fn may_steer(caller: &Caller) -> bool {
    match caller {
        Caller::Anyone => false,
        Caller::Holder(_) => caller.may(Scope::Admin).is_ok(),
    }
}

/// Whether a form comes from a page of this port by the browser's headers, or from a program with a token of
/// its own.
pub(super) fn is_own_form(headers: &HeaderMap) -> bool {
    let text = |name: &header::HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
    if let Some(site) = text(&header::HeaderName::from_static("sec-fetch-site")) {
        return site == "same-origin";
    }
    match text(&header::ORIGIN).map(|origin| origin.split_once("://")) {
        Some(origin) => {
            let (own, host) = (origin.map(|(_, authority)| authority), text(&header::HOST));
            own.is_some() && own == host
        }
        None => headers.contains_key(header::AUTHORIZATION) && !headers.contains_key(header::COOKIE),
    }
}

/// Sets the field of the policy that a form names to its value, or back to its default where that is empty.
pub(super) async fn set_field(visitor: &Visitor<'_>, id: &str, form: &Query) -> Result<(), Error> {
    let (field, value) = (form.text("field"), form.text("value"));
    let change = if value.is_empty() {
        PolicyChange::clear([field])
    } else {
        let mut set = PolicySettings::new();
        set.set_text(&field, &value).map_err(|error| Error::invalid("value", error))?;
        PolicyChange::set(set)
    };
    update(visitor, id, policy_to_wire(change.values()), change.paths()).await
}

/// Gives every client of the study the configuration of one of its trials.
pub(super) async fn pin(visitor: &Visitor<'_>, id: &str, number: &str) -> Result<(), Error> {
    let request = v1::GetTrialRequest { name: format!("studies/{id}/trials/{number}") };
    let trial = rpc::trials::get(visitor.tuning, visitor.caller, request).await?;
    let policy = v1::Policy { pinned: trial.configuration, ..v1::Policy::default() };
    update(visitor, id, policy, vec!["policy.pinned".to_owned()]).await
}

async fn update(
    visitor: &Visitor<'_>,
    id: &str,
    policy: v1::Policy,
    paths: Vec<String>,
) -> Result<(), Error> {
    if !may_steer(visitor.caller) {
        return Err(Error::Denied("only a token of scope admin changes a study from its pages"));
    }
    let changed = paths.join(", ");
    let study = v1::Study { name: format!("studies/{id}"), policy: Some(policy), ..v1::Study::default() };
    let request = v1::UpdateStudyRequest { study: Some(study), update_mask: Some(FieldMask { paths }) };
    rpc::studies::update(visitor.tuning, visitor.caller, request).await?;
    tracing::info!(study = id, changed, token = visitor.caller.id(), "changed from the dashboard");
    Ok(())
}

#[cfg(test)]
mod tests {
    use http::HeaderValue;

    use super::*;

    #[test]
    fn a_form_of_another_site_is_not_our_own() {
        let is_own = |given: &[(&'static str, &'static str)]| {
            let headers = given.iter().map(|(name, value)| {
                (header::HeaderName::from_static(name), HeaderValue::from_static(value))
            });
            is_own_form(&headers.collect())
        };
        let host = ("host", "127.0.0.1:8080");
        let cookie = ("cookie", "treewright_token=tw1_x");
        assert!(is_own(&[host, cookie, ("origin", "http://127.0.0.1:8080")]));
        assert!(is_own(&[host, cookie, ("sec-fetch-site", "same-origin"), ("origin", "null")]));
        assert!(is_own(&[host, ("authorization", "Bearer tw1_x")]), "a program");
        for bad in [
            &[host, cookie][..],
            &[host, cookie, ("origin", "null")],
            &[host, cookie, ("origin", "http://127.0.0.1:8081")],
            &[host, cookie, ("origin", "http://evil.example")],
            &[host, cookie, ("sec-fetch-site", "cross-site"), ("origin", "http://127.0.0.1:8080")],
            &[host, cookie, ("sec-fetch-site", "same-site")],
            &[host, cookie, ("authorization", "Bearer tw1_x")],
            &[("origin", "http://127.0.0.1:8080"), cookie],
        ] {
            assert!(!is_own(bad), "{bad:?}");
        }
        assert!(!may_steer(&Caller::Anyone));
    }
}
