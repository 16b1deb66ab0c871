//! The other dashboards in the list of studies.

use http::HeaderValue;

use crate::limits::{DASHBOARD_PEER_NAME, DASHBOARD_TOKEN_BYTES};

/// The form in which another dashboard is named.
const FORM: &str = "write NAME=http://HOST:PORT; let a tunnel or a proxy on this machine bring https near";

/// Another daemon's dashboard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DashboardPeer {
    /// Its name in the list of studies.
    pub name: String,
    /// Its host and port, as in `127.0.0.1:8081`.
    pub authority: String,
    /// The header that shows it a token.
    pub token: Option<HeaderValue>,
}

/// The token for the dashboard of this name.
#[derive(Clone, Debug)]
pub struct DashboardToken {
    pub(super) name: String,
    pub(super) header: HeaderValue,
}

impl DashboardPeer {
    /// Its address without a slash at the end.
    pub fn url(&self) -> String {
        format!("http://{}", self.authority)
    }

    /// Whether it is asked without leaving this machine.
    pub(super) fn is_near(&self) -> bool {
        let host = self.authority.rsplit_once(':').map_or(self.authority.as_str(), |(host, _)| host);
        let address = host.trim_matches(['[', ']']).parse::<std::net::IpAddr>();
        host == "localhost" || address.is_ok_and(|address| address.is_loopback())
    }
}

/// Reads `NAME=http://HOST:PORT`.
pub(super) fn peer(text: &str) -> Result<DashboardPeer, String> {
    let (name, url) = text.split_once('=').ok_or(FORM)?;
    let name = name.trim();
    if name.is_empty() || name.chars().count() > DASHBOARD_PEER_NAME || name.chars().any(char::is_control) {
        return Err(format!("the name needs 1 to {DASHBOARD_PEER_NAME} printable characters; {FORM}"));
    }
    let url = url.trim().parse::<http::Uri>().map_err(|_| FORM)?;
    let (Some("http"), Some(host), None, "" | "/", None) =
        (url.scheme_str(), url.host(), url.query(), url.path(), user_of(&url))
    else {
        return Err(FORM.to_owned());
    };
    // A port that is none must not lead to the usual one.
    let port = match url.authority().and_then(|authority| authority.as_str().strip_prefix(host)) {
        Some("") => 80,
        _ => url.port_u16().filter(|port| *port > 0).ok_or(FORM)?,
    };
    let authority = format!("{host}:{port}");
    Ok(DashboardPeer { name: name.to_owned(), authority, token: None })
}

/// The user that a URL names: secrets do not belong into it.
fn user_of(url: &http::Uri) -> Option<&str> {
    Some(url.authority()?.as_str().split_once('@')?.0)
}

/// Reads `NAME=FILE`, and the token in the file.
pub(super) fn token_file(text: &str) -> Result<DashboardToken, String> {
    let (name, path) = text.split_once('=').ok_or("write NAME=FILE with a name of --dashboard-peers")?;
    let text = std::fs::read_to_string(path).map_err(|error| format!("{path}: {error}"))?;
    let token = text.trim();
    let header = HeaderValue::try_from(format!("Bearer {token}"));
    match header {
        Ok(mut header) if !token.is_empty() && text.len() <= DASHBOARD_TOKEN_BYTES => {
            header.set_sensitive(true);
            Ok(DashboardToken { name: name.trim().to_owned(), header })
        }
        _ => Err(format!("{path} holds no token; put the output of `treewrightd token create` there")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_dashboard_is_a_name_and_an_address() {
        for (text, name, authority, is_near) in [
            ("farm=http://127.0.0.1:8081", "farm", "127.0.0.1:8081", true),
            ("farm 2 = http://localhost:8081/", "farm 2", "localhost:8081", true),
            ("v6=http://[::1]:8081", "v6", "[::1]:8081", true),
            ("far=http://10.0.0.7", "far", "10.0.0.7:80", false),
            ("far=http://render.example:8080", "far", "render.example:8080", false),
        ] {
            let read = peer(text).expect(text);
            assert_eq!((read.name.as_str(), read.authority.as_str()), (name, authority));
            assert_eq!(read.is_near(), is_near, "{text}");
            assert_eq!(peer(&format!("{name}={}", read.url())), Ok(read));
        }
        for bad in [
            "http://127.0.0.1:8081",
            "=http://127.0.0.1:8081",
            "a=127.0.0.1:8081",
            "a=https://127.0.0.1:8081",
            "a=ftp://127.0.0.1:8081",
            "a=http://127.0.0.1:8081/studies",
            "a=http://127.0.0.1:8081/?x=1",
            "a=http://user:geheim@127.0.0.1:8081",
            "a=http://127.0.0.1:80810",
            "a=http://127.0.0.1:808l",
            "a=http://127.0.0.1:0",
            "a\u{7}=http://127.0.0.1:8081",
        ] {
            let error = peer(bad).expect_err(bad);
            assert!(error.contains("NAME=http://HOST:PORT") && !error.contains("geheim"), "{error}");
        }
    }

    #[test]
    fn a_token_is_read_and_not_shown() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("token");
        let argument = format!("farm={}", file.to_str().expect("text"));
        std::fs::write(&file, "tw1_geheim\n").expect("written");
        let token = token_file(&argument).expect("a token");
        assert_eq!((token.name.as_str(), token.header.as_bytes()), ("farm", &b"Bearer tw1_geheim"[..]));
        assert!(!format!("{token:?}").contains("geheim"), "{token:?}");
        for bad in ["", " \n", "a\u{1}b"] {
            std::fs::write(&file, bad).expect("written");
            assert!(token_file(&argument).expect_err(bad).contains("token create"));
        }
        assert!(token_file("farm=/missing").expect_err("no file").contains("/missing"));
        assert!(token_file("/missing").expect_err("no name").contains("NAME=FILE"));
    }
}
