//! The query of an address, in which a form is sent as well.

/// Names and values.
#[derive(Debug, Default)]
pub(super) struct Query(Vec<(String, String)>);

impl Query {
    /// Reads `name=value&…` with the escapes of forms.
    pub(super) fn read(text: &str) -> Self {
        Self(form_urlencoded::parse(text.as_bytes()).into_owned().collect())
    }

    /// The first value of a name; empty where there is none.
    pub(super) fn text(&self, name: &str) -> String {
        let found = self.0.iter().find(|(known, _)| known == name);
        found.map(|(_, value)| value.trim().to_owned()).unwrap_or_default()
    }

    /// All values of a name, in order.
    pub(super) fn texts(&self, name: &str) -> Vec<String> {
        let found = self.0.iter().filter(|(known, _)| known == name);
        found.map(|(_, value)| value.trim().to_owned()).filter(|value| !value.is_empty()).collect()
    }

    /// A whole number above 0.
    pub(super) fn number(&self, name: &str) -> Option<i64> {
        self.text(name).parse().ok().filter(|number| *number > 0)
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
        assert_eq!(Query::read("state=3").number("state"), Some(3));
        assert_eq!(Query::read("state=-3").number("state"), None);
        assert_eq!(Query::read("state=x").number("state"), None);
    }
}
