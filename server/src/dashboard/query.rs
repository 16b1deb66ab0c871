//! The query of an address, in which a form is sent as well.

use crate::error::{Error, Result};

#[derive(Debug, Default)]
pub(super) struct Query(Vec<(String, String)>);

impl Query {
    /// Reads `name=value&…` with the escapes of forms.
    pub(super) fn read(text: &str) -> Self {
        Self(form_urlencoded::parse(text.as_bytes()).into_owned().collect())
    }

    /// The first value of a name; empty where there is none.
    pub(super) fn text(&self, name: &str) -> String {
        self.given(name).map(|value| value.trim().to_owned()).unwrap_or_default()
    }

    /// The first value of a name with its blanks; `None` where the name is not given.
    pub(super) fn given(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// All values of a name, in order.
    pub(super) fn texts(&self, name: &str) -> Vec<String> {
        let found = self.0.iter().filter(|(known, _)| known == name);
        found.map(|(_, value)| value.trim().to_owned()).filter(|value| !value.is_empty()).collect()
    }

    /// A whole number above 0; `None` where none is given.
    pub(super) fn number(&self, name: &str) -> Result<Option<i64>> {
        let text = self.text(name);
        match text.parse() {
            _ if text.is_empty() => Ok(None),
            Ok(number) if number > 0 => Ok(Some(number)),
            _ => Err(Error::invalid(
                name,
                format!("{text:?} is no whole number above 0; leave it out, or give one"),
            )),
        }
    }

    /// The one of some words that is given, the first where none is.
    pub(super) fn word<'a>(&self, name: &str, words: &[&'a str]) -> Result<&'a str> {
        let text = self.text(name);
        let found = words.iter().find(|word| text.is_empty() || **word == text);
        found.copied().ok_or_else(|| {
            let words = words.join(", ");
            Error::invalid(name, format!("{text:?} is none of them; use one of: {words}"))
        })
    }

    /// Checks that nothing is given but these names: a mistyped one would be passed over.
    pub(super) fn only(&self, names: &[&str]) -> Result<()> {
        match self.0.iter().find(|(name, _)| !names.contains(&name.as_str())) {
            None => Ok(()),
            Some((name, _)) => {
                let names =
                    if names.is_empty() { String::new() } else { format!("use {}, or ", names.join(", ")) };
                Err(Error::invalid(name, format!("this page does not know it; {names}leave it out")))
            }
        }
    }

    /// A text that [`Query::read`] reads.
    pub(super) fn written(pairs: &[(&str, &String)]) -> String {
        let mut text = form_urlencoded::Serializer::new(String::new());
        for (name, value) in pairs.iter().filter(|(_, value)| !value.is_empty()) {
            text.append_pair(name, value);
        }
        let text = text.finish();
        debug_assert!(
            pairs.iter().all(|(name, value)| Self::read(&text).text(name) == value.trim()),
            "{text} is read as something else"
        );
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let (filter, page) = ("cost < 12.5 AND client_id = \"a&b\"".to_owned(), "x+/=".to_owned());
        let text = Query::written(&[("filter", &filter), ("order", &String::new()), ("page", &page)]);
        let query = Query::read(&text);
        assert_eq!((query.text("filter"), query.text("page")), (filter, page));
        assert_eq!(query.text("order"), "");
        assert_eq!(Query::read("study=a&study=b%20&study=").texts("study"), ["a", "b"]);
        assert_eq!(Query::read("state=3").number("state"), Ok(Some(3)));
        assert_eq!(Query::read("state=").number("state"), Ok(None));
    }

    #[test]
    fn what_cannot_be_read_is_named_with_the_remedy() {
        let said = |error: Error| error.to_string();
        for bad in ["state=-3", "state=0", "state=x", "state=1.5"] {
            let error = said(Query::read(bad).number("state").expect_err(bad));
            assert!(error.starts_with("state: ") && error.contains("leave it out"), "{error}");
        }
        let words = ["Study", "Gain"];
        assert_eq!(Query::read("").word("order", &words), Ok("Study"));
        assert_eq!(Query::read("order=Gain").word("order", &words), Ok("Gain"));
        let error = said(Query::read("order=gain").word("order", &words).expect_err("another word"));
        assert!(error.contains("\"gain\"") && error.contains("Study, Gain"), "{error}");
        assert_eq!(Query::read("state=1&state=2").only(&["state"]), Ok(()));
        let error = said(Query::read("state=1&stat=2").only(&["state"]).expect_err("another name"));
        assert!(error.starts_with("stat: ") && error.contains("; use state, or leave"), "{error}");
        let error = said(Query::read("state=1").only(&[]).expect_err("any name"));
        assert!(error.contains("; leave it out"), "{error}");
    }
}
