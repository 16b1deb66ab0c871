//! Changes of a study from its pages, for visitors with the needed scope.
//!
//! A form that another site sends in a browser's name changes nothing: the cookie stays away from it, and a
//! form has to come from a page of this port ([`is_own_form`]). Forms name their study by its identity, so
//! that one from an old page does not change another study that was created under its id.

use std::collections::BTreeSet;

use http::{HeaderMap, header};
use prost_types::FieldMask;
use treewright_core::policy::{PolicyChange, PolicySettings};
use treewright_proto::convert::{policy_to_wire, value_from_wire};
use treewright_proto::v1;

use super::query::Query;
use super::{LOADING_WAITS, Visitor, is_loading, may_steer, pages};
use crate::error::{Error, Result};
use crate::rpc;
use treewright_store::StoreError;

pub(super) enum Steered {
    /// The study is changed, and this page shows it, under the id that the study has by now.
    Changed(String),
    /// Another replica holds the study and nothing is changed; what to do instead.
    Elsewhere(String),
}

struct FormChange {
    request: FormRequest,
    /// The words for the log.
    changed: String,
    /// The command of `treewright` that does this, too, and what stands there behind the study's id.
    command: (&'static str, String),
}

enum FormRequest {
    /// A change of a study, and the end of the address of the page that shows it.
    Study(Box<v1::UpdateStudyRequest>, &'static str),
    Exclusion(v1::ExcludeTrialRequest),
}

impl FormRequest {
    /// A change of these fields of a study.
    fn of_study(study: v1::Study, paths: Vec<String>, page: &'static str) -> Self {
        let update_mask = Some(FieldMask { paths });
        Self::Study(Box::new(v1::UpdateStudyRequest { study: Some(study), update_mask }), page)
    }

    /// Sends it as its RPC, and returns the page that shows the change.
    async fn send(&self, visitor: &Visitor<'_>) -> Result<String> {
        match self {
            Self::Study(request, page) => {
                let study =
                    rpc::studies::update(visitor.call(), v1::UpdateStudyRequest::clone(request)).await?;
                Ok(format!("/studies/{}{page}", pages::id(&study.name)))
            }
            Self::Exclusion(request) => {
                let trial = rpc::trials::exclude(visitor.call(), request.clone()).await?;
                Ok(format!("/{}", trial.name))
            }
        }
    }
}

pub(super) enum SteeringForm<'a> {
    Field,
    Texts,
    Pin(&'a str),
    Exclude(&'a str),
    Include(&'a str),
}

impl<'a> SteeringForm<'a> {
    /// The study and the form of an address, in its parts.
    pub(super) fn at(parts: &[&'a str]) -> Option<(&'a str, Self)> {
        Some(match *parts {
            ["studies", study, "policy"] => (study, Self::Field),
            ["studies", study, "texts"] => (study, Self::Texts),
            ["studies", study, "trials", number, "pin"] => (study, Self::Pin(number)),
            ["studies", study, "trials", number, "exclude"] => (study, Self::Exclude(number)),
            ["studies", study, "trials", number, "include"] => (study, Self::Include(number)),
            _ => return None,
        })
    }

    /// Does what a form asks for. The study is named by its id or as `ID@UID`.
    pub(super) async fn steer(&self, visitor: &Visitor<'_>, study: &str, form: &Query) -> Result<Steered> {
        let change = match self {
            Self::Field => set_field(study, form)?,
            Self::Texts => texts(visitor, study, form).await?,
            Self::Pin(number) => pin(visitor, study, number).await?,
            Self::Exclude(number) => exclusion(study, number, Some(form.text("reason"))),
            Self::Include(number) => exclusion(study, number, None),
        };
        update(visitor, change).await
    }
}

/// Whether a form comes from a page of this port by the browser's headers, or from a program with a token of
/// its own.
pub(super) fn is_own_form(headers: &HeaderMap) -> bool {
    let is_program = || headers.contains_key(header::AUTHORIZATION) && !headers.contains_key(header::COOKIE);
    says_own(headers).unwrap_or_else(is_program)
}

/// Whether a form comes from a page of another site. Who logs in or out with a program shows no token yet.
pub(super) fn is_foreign_form(headers: &HeaderMap) -> bool {
    says_own(headers) == Some(false)
}

/// Whether the browser says that a form comes from a page of this port; `None` where it says nothing.
fn says_own(headers: &HeaderMap) -> Option<bool> {
    let text = |name: &header::HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
    if let Some(site) = text(&header::HeaderName::from_static("sec-fetch-site")) {
        return Some(site == "same-origin");
    }
    let origin = text(&header::ORIGIN)?;
    let (own, host) = (origin.split_once("://").map(|(_, authority)| authority), text(&header::HOST));
    Some(own.is_some() && own == host)
}

/// Sets the field of the policy that a form names to its value, or back to its default where that is empty.
fn set_field(study: &str, form: &Query) -> Result<FormChange> {
    let (field, value) = (form.text("field"), form.text("value"));
    let command = ("policy", format!(" {}", flag(&field, &value)));
    let change = if value.is_empty() {
        PolicyChange::clear([field])
    } else {
        let mut set = PolicySettings::new();
        set.set_text(&field, &value).map_err(|error| Error::invalid("value", error))?;
        PolicyChange::set(set)
    };
    Ok(policy_change(study, policy_to_wire(change.values()), change.paths(), command))
}

fn policy_change(
    study: &str,
    policy: v1::Policy,
    paths: Vec<String>,
    command: (&'static str, String),
) -> FormChange {
    let study = v1::Study { name: format!("studies/{study}"), policy: Some(policy), ..v1::Study::default() };
    FormChange { changed: paths.join(", "), request: FormRequest::of_study(study, paths, "/policy"), command }
}

/// Sets the note and the tags of a study where somebody wrote others than the page had shown.
async fn texts(visitor: &Visitor<'_>, study: &str, form: &Query) -> Result<FormChange> {
    let name = format!("studies/{study}");
    let request = v1::GetStudyRequest { name: name.clone() };
    let stored = rpc::studies::get(visitor.call(), request).await?;
    let changed = |text| Error::TextChanged { study: pages::id(&stored.name).to_owned(), text };
    // Browsers end lines in this way.
    let note = |field: &str| form.given(field).map(|text| text.replace("\r\n", "\n"));
    let note = merged(note("note"), note("note_shown"), &stored.note).ok_or_else(|| changed("note"))?;
    let words = |text: &str| -> BTreeSet<String> {
        text.replace(',', " ").split_whitespace().map(str::to_owned).collect()
    };
    let tags = |field: &str| form.given(field).map(words);
    let before: BTreeSet<String> = stored.tags.iter().cloned().collect();
    let tags = merged(tags("tags"), tags("tags_shown"), &before).ok_or_else(|| changed("tags"))?;
    let (mut paths, mut said) = (Vec::new(), String::new());
    // Where nothing was written the note stays what it is: a mask of nothing would mean the policy.
    if note != stored.note || tags == before {
        paths.push("note".to_owned());
        said += &format!(" --note={}", shell_word(&note));
    }
    for (flag, these, others) in [("tag", &tags, &before), ("untag", &before, &tags)] {
        for tag in these.difference(others) {
            paths.push(format!("tags.{tag}"));
            said += &format!(" --{flag}={}", shell_word(tag));
        }
    }
    let study = v1::Study { name, note, tags: tags.into_iter().collect(), ..v1::Study::default() };
    let (changed, request) = (paths.join(", "), FormRequest::of_study(study, paths, ""));
    Ok(FormChange { changed, request, command: ("study edit", said) })
}

/// The new value of a stored one by a form, which carries the value that its page had shown. It stays where
/// the form does not change it. `None` where somebody else has changed it as well.
fn merged<T: Clone + PartialEq>(given: Option<T>, shown: Option<T>, stored: &T) -> Option<T> {
    match given {
        Some(given) if shown.as_ref() != Some(&given) => {
            let is_free = given == *stored || shown.is_none_or(|shown| shown == *stored);
            is_free.then_some(given)
        }
        _ => Some(stored.clone()),
    }
}

/// Excludes a trial for a reason, or counts it again without one.
fn exclusion(study: &str, number: &str, reason: Option<String>) -> FormChange {
    let (verb, include) = (if reason.is_some() { "exclude" } else { "include" }, reason.is_none());
    let said = reason.as_ref().map(|reason| format!(" {}", shell_word(reason))).unwrap_or_default();
    let trial = format!("studies/{study}/trials/{number}");
    let reason = reason.unwrap_or_default();
    FormChange {
        changed: format!("{verb} trial {number}"),
        request: FormRequest::Exclusion(v1::ExcludeTrialRequest { trial, reason, include }),
        command: (verb, format!("/trials/{number}{said}")),
    }
}

/// Gives every client of the study the configuration of one of its trials. Both the trial and the policy are
/// those of the study that the form names.
async fn pin(visitor: &Visitor<'_>, study: &str, number: &str) -> Result<FormChange> {
    let request = v1::GetTrialRequest { name: format!("studies/{study}/trials/{number}") };
    let trial = rpc::trials::get(visitor.call(), request).await?;
    let mut words = Vec::new();
    for (name, value) in trial.configuration.iter().flat_map(|configuration| &configuration.values) {
        let value = value_from_wire("configuration", value.clone())?;
        words.push(shell_word(&format!("{name}={value}")));
    }
    let policy = v1::Policy { pinned: trial.configuration, ..v1::Policy::default() };
    let (paths, command) = (vec!["policy.pinned".to_owned()], ("pin", format!(" {}", words.join(" "))));
    Ok(policy_change(study, policy, paths, command))
}

/// Changes the study. One that is being read into memory is waited for.
async fn update(visitor: &Visitor<'_>, change: FormChange) -> Result<Steered> {
    if !may_steer(visitor.caller) {
        return Err(Error::Denied("only a token of scope admin changes a study from its pages"));
    }
    let FormChange { request, changed, command } = change;
    let mut waits = 0;
    loop {
        match request.send(visitor).await {
            Ok(page) => {
                tracing::info!(page, changed, token = visitor.caller.id(), "changed from the dashboard");
                return Ok(Steered::Changed(page));
            }
            Err(Error::Store(StoreError::Elsewhere { study, address })) => {
                return Ok(Steered::Elsewhere(advice(&study, &address, &command)));
            }
            Err(problem) if is_loading(&problem) && waits < LOADING_WAITS => waits += 1,
            Err(problem) => return Err(problem),
        }
    }
}

/// Advice where another replica holds the study. Requests of the command line are passed on to it, forms are
/// not.
fn advice(study: &str, address: &str, (verb, rest): &(&'static str, String)) -> String {
    format!(
        "Nothing was changed: the replica at {address} holds study {study}, and a page changes only what its \
         own replica holds. Use the dashboard of that replica, or run this with any of them as the server: \
         treewright {verb} {study}{rest}"
    )
}

/// The arguments of `treewright policy` that set a field, or set it back where the value is empty.
fn flag(field: &str, value: &str) -> String {
    match (field, value) {
        ("pinned", "") => "--unpin".to_owned(),
        ("pinned", _) => format!("--pin {}", shell_word(value)),
        (_, "") => format!("--clear {}", shell_word(field)),
        _ => format!("--{} {}", field.replace('_', "-"), shell_word(value)),
    }
}

fn shell_word(word: &str) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "=_-.,+:/@%".contains(letter);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use http::HeaderValue;

    use super::*;
    use crate::access::caller::Caller;

    #[test]
    fn a_form_of_another_site_is_not_our_own() {
        let headers = |given: &[(&'static str, &'static str)]| -> HeaderMap {
            let headers = given.iter().map(|(name, value)| {
                (header::HeaderName::from_static(name), HeaderValue::from_static(value))
            });
            headers.collect()
        };
        let is_own = |given: &[(&'static str, &'static str)]| is_own_form(&headers(given));
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
        // A program that logs in has no token to show.
        assert!(!is_foreign_form(&headers(&[host])));
        assert!(!is_foreign_form(&headers(&[host, ("origin", "http://127.0.0.1:8080")])));
        assert!(is_foreign_form(&headers(&[host, ("origin", "http://evil.example")])));
        assert!(is_foreign_form(&headers(&[host, cookie, ("sec-fetch-site", "cross-site")])));
    }

    #[test]
    fn advice_names_the_holder_and_the_command_that_does_the_same() {
        let command = |field: &str, value: &str| {
            let said =
                advice("hall", "http://10.0.0.7:7878", &("policy", format!(" {}", flag(field, value))));
            assert!(said.contains("the replica at http://10.0.0.7:7878 holds study hall"), "{said}");
            said.rsplit(": ").next().unwrap_or_default().to_owned()
        };
        assert_eq!(command("operation", "freeze"), "treewright policy hall --operation freeze");
        assert_eq!(command("regret_budget", "0.05"), "treewright policy hall --regret-budget 0.05");
        assert_eq!(command("operation", ""), "treewright policy hall --clear operation");
        assert_eq!(command("pinned", ""), "treewright policy hall --unpin");
        assert_eq!(
            ["a=-1.5", "kind=<b>", "it's", ""].map(shell_word),
            ["a=-1.5", "'kind=<b>'", r"'it'\''s'", "''"]
        );
        let excludes = exclusion("hall", "7", Some("the fan failed".to_owned())).command;
        let said = advice("hall", "http://10.0.0.7:7878", &excludes);
        assert!(said.ends_with(": treewright exclude hall/trials/7 'the fan failed'"), "{said}");
    }

    #[test]
    fn a_form_changes_what_somebody_wrote_and_undoes_nobody_elses_change() {
        for (given, shown, stored, becomes) in [
            (Some("new"), Some("old"), "old", Some("new")),
            (Some("old"), Some("old"), "another's", Some("another's")),
            (Some("new"), Some("old"), "another's", None),
            (Some("new"), Some("old"), "new", Some("new")),
            (Some(""), Some("old"), "old", Some("")),
            // From programs.
            (Some("new"), None, "old", Some("new")),
            (None, None, "old", Some("old")),
        ] {
            assert_eq!(merged(given, shown, &stored), becomes, "{given:?} {shown:?} {stored}");
        }
    }

    #[test]
    fn only_what_passes_by_itself_is_asked_again() {
        let study = || "hall".to_owned();
        assert!(is_loading(&Error::Loading(study())));
        assert!(is_loading(&Error::Reloading(study())));
        assert!(is_loading(&Error::Store(StoreError::Fenced(study()))));
        for other in [
            Error::Store(StoreError::StudyNotFound(study())),
            Error::Store(StoreError::Elsewhere { study: study(), address: study() }),
            Error::Store(StoreError::Closed),
            Error::Draining,
        ] {
            assert!(!is_loading(&other), "{other}");
        }
    }
}
