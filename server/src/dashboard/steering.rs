//! Changes of a study's policy from its pages, for visitors whose token may change it.
//!
//! A form that another site sends in a browser's name changes nothing: the cookie stays away from it, and a
//! form has to come from a page of this port ([`is_own_form`]). Forms name their study by its identity, so
//! that one from an old page does not change another study that was created under the same id.

use http::{HeaderMap, header};
use prost_types::FieldMask;
use treewright_core::policy::{PolicyChange, PolicySettings};
use treewright_proto::convert::policy_to_wire;
use treewright_proto::v1;

use super::query::Query;
use super::{Visitor, pages};
use crate::access::caller::Caller;
use crate::error::Error;
use crate::rpc;
use treewright_store::tokens::Scope;

/// Whether the caller may change studies here. Where no token is asked for nobody may: a proxy in front of
/// the pages would let everybody steer whom it lets look.
pub(super) fn may_steer(caller: &Caller) -> bool {
    match caller {
        Caller::Anyone => false,
        Caller::Holder(_) => caller.may(Scope::Admin).is_ok(),
    }
}

/// Whether a form comes from a page of this port, as browsers say it, or from a program that shows its token
/// itself.
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
/// Returns the id that the study, named by its id or as `ID@UID`, has by now.
pub(super) async fn set_field(visitor: &Visitor<'_>, study: &str, form: &Query) -> Result<String, Error> {
    let (field, value) = (form.text("field"), form.text("value"));
    let change = if value.is_empty() {
        PolicyChange::clear([field])
    } else {
        let mut set = PolicySettings::new();
        set.set_text(&field, &value).map_err(|error| Error::invalid("value", error))?;
        PolicyChange::set(set)
    };
    update(visitor, study, policy_to_wire(change.values()), change.paths()).await
}

/// Gives every client of the study the configuration of one of its trials. Returns the study's id. Both the
/// trial and the policy are those of the study that the form names.
pub(super) async fn pin(visitor: &Visitor<'_>, study: &str, number: &str) -> Result<String, Error> {
    let request = v1::GetTrialRequest { name: format!("studies/{study}/trials/{number}") };
    let trial = rpc::trials::get(visitor.tuning, visitor.caller, request).await?;
    let policy = v1::Policy { pinned: trial.configuration, ..v1::Policy::default() };
    update(visitor, study, policy, vec!["policy.pinned".to_owned()]).await
}

async fn update(
    visitor: &Visitor<'_>,
    study: &str,
    policy: v1::Policy,
    paths: Vec<String>,
) -> Result<String, Error> {
    if !may_steer(visitor.caller) {
        return Err(Error::Denied("only a token of scope admin changes a study from its pages"));
    }
    let changed = paths.join(", ");
    let study = v1::Study { name: format!("studies/{study}"), policy: Some(policy), ..v1::Study::default() };
    let request = v1::UpdateStudyRequest { study: Some(study), update_mask: Some(FieldMask { paths }) };
    let study = rpc::studies::update(visitor.tuning, visitor.caller, request).await?;
    let id = pages::id(&study.name);
    tracing::info!(study = id, changed, token = visitor.caller.id(), "changed from the dashboard");
    Ok(id.to_owned())
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
