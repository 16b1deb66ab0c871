//! Resource names: `studies/{study}` and `studies/{study}/trials/{trial}`, where `{study}@{uid}` may stand
//! for `{study}`.

use std::fmt;

use treewright_core::ids::StudyUid;

use crate::error::{Error, Result};
use crate::limits::{NAME_BYTES, STUDY_ID_CHARACTERS};

/// A study's name in a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StudyName {
    /// The study's id; after a look-up by identity, its present id.
    pub id: String,
    /// Its identity, if the request gives one.
    pub uid: Option<StudyUid>,
}

impl From<&str> for StudyName {
    fn from(id: &str) -> Self {
        Self { id: id.to_owned(), uid: None }
    }
}

impl fmt::Display for StudyName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "studies/{}", self.id)?;
        self.uid.map_or(Ok(()), |uid| write!(f, "@{uid}"))
    }
}

/// A trial's place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrialName {
    /// The study.
    pub study: StudyName,
    /// The trial's number, from 1.
    pub number: u64,
}

/// Checks the id of a study that is to be created.
pub fn study_id(field: &str, id: &str) -> Result<String> {
    let spelt = id.starts_with(|c: char| c.is_ascii_lowercase())
        && id.bytes().all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_'));
    if spelt && id.len() <= STUDY_ID_CHARACTERS {
        return Ok(id.to_owned());
    }
    Err(Error::invalid(
        field,
        format!(
            "{:?} must be 1 to {STUDY_ID_CHARACTERS} characters of a-z, 0-9, - and _, beginning with a letter",
            shortened(id)
        ),
    ))
}

/// Reads `studies/{study}`.
pub fn study(field: &str, name: &str) -> Result<StudyName> {
    let read = short(name).and_then(|name| name.strip_prefix("studies/")).and_then(place);
    debug_assert!(read.as_ref().is_none_or(|read| read.to_string() == name), "{name:?} is read as {read:?}");
    read.ok_or_else(|| {
        let name = shortened(name);
        Error::invalid(field, format!("{name:?} must have the form studies/STUDY"))
    })
}

/// Reads `{study}` or `{study}@{uid}`.
fn place(text: &str) -> Option<StudyName> {
    let (id, uid) = match text.split_once('@') {
        Some((id, uid)) => (id, Some(uid.parse().ok()?)),
        None => (text, None),
    };
    Some(StudyName { id: study_id("", id).ok()?, uid })
}

/// Reads `studies/{study}/trials/{trial}`.
pub fn trial(field: &str, name: &str) -> Result<TrialName> {
    let read = || {
        let (study, number) = short(name)?.strip_prefix("studies/")?.split_once("/trials/")?;
        let plain = number.starts_with(|c: char| matches!(c, '1'..='9'));
        Some(TrialName { study: place(study)?, number: number.parse().ok().filter(|_| plain)? })
    };
    let read = read();
    let is_same = |read: &TrialName| trial_name(&read.study, read.number) == name;
    debug_assert!(read.as_ref().is_none_or(is_same), "{name:?} is read as {read:?}");
    read.ok_or_else(|| {
        let name = shortened(name);
        let form = "must have the form studies/STUDY/trials/NUMBER";
        Error::invalid(field, format!("{name:?} {form}"))
    })
}

/// Writes `studies/{study}`.
pub fn study_name(study: &str) -> String {
    format!("studies/{study}")
}

/// Writes `studies/{study}/trials/{trial}`.
pub fn trial_name(study: &StudyName, number: u64) -> String {
    format!("{study}/trials/{number}")
}

fn short(name: &str) -> Option<&str> {
    (name.len() <= NAME_BYTES).then_some(name)
}

/// The part of a name that fits into a message.
fn shortened(name: &str) -> String {
    const SHOWN: usize = 80;
    let mut text: String = name.chars().take(SHOWN).collect();
    if text.len() < name.len() {
        text.push_str("...");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        let plain = StudyName::from("hall-2_b");
        let identified = StudyName { uid: Some(StudyUid(0xabc)), ..plain.clone() };
        assert_eq!(study_name("hall-2_b"), plain.to_string());
        assert_eq!(identified.to_string(), "studies/hall-2_b@0000000000000abc");
        for name in [plain, identified] {
            assert_eq!(study("name", &name.to_string()).unwrap(), name);
            let read = trial("name", &trial_name(&name, 17)).unwrap();
            assert_eq!(read, TrialName { study: name, number: 17 });
        }
    }

    #[test]
    fn other_names_are_refused_with_their_field() {
        let long = "a".repeat(STUDY_ID_CHARACTERS + 1);
        for bad in ["", "Hall", "2hall", "hall/1", "häll", &long] {
            let error = study_id("study_id", bad).unwrap_err().to_string();
            assert!(error.starts_with("study_id: "), "{error}");
        }
        for bad in [
            "",
            "hall",
            "studies/",
            "studies/Hall",
            "studies/hall/trials/1",
            "studies/hall@",
            "studies/hall@0000000000000ABC",
            "studies/@0000000000000abc",
        ] {
            assert!(study("study", bad).is_err(), "{bad}");
        }
        for bad in [
            "studies/hall",
            "studies/hall/trials/",
            "studies/hall/trials/0",
            "studies/hall/trials/+1",
            "studies/hall/trials/01",
            "studies/hall/trials/-1",
            "studies/hall/trials/18446744073709551616",
        ] {
            assert!(trial("trial", bad).is_err(), "{bad}");
        }
        let huge = format!("studies/{}", "x".repeat(1_000_000));
        assert!(study("study", &huge).unwrap_err().to_string().len() < 200);
    }
}
