//! Settings in a file: `~/.config/treewright/config.toml`. An argument goes before an environment variable,
//! the variable before the file, and the file before the built-in value.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _};
use serde::{Deserialize, Serialize};
use treewright_client::{CredentialArguments, TLS_ARGUMENTS, overrules_tls, without_empty_variables};

use crate::arguments::Arguments;
use crate::failure::Failure;
use crate::files;

/// The variable that names another file.
const VARIABLE: &str = "TREEWRIGHT_CONFIG";
/// The file's name in its folder.
const NAME: &str = "config.toml";

/// The settings; each has the name of its argument.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Where the daemon listens, or `local`.
    server: Option<String>,
    /// How long to wait for it, e.g. `10s`.
    timeout: Option<String>,
    /// File that holds a token.
    token_file: Option<String>,
    /// Authority of the daemon's certificate.
    tls_ca: Option<String>,
    /// Certificate to show.
    tls_cert: Option<String>,
    /// Its key.
    tls_key: Option<String>,
}

impl File {
    fn entries(&self) -> [(&'static str, Option<&String>); 6] {
        [
            ("server", self.server.as_ref()),
            ("timeout", self.timeout.as_ref()),
            ("token_file", self.token_file.as_ref()),
            ("tls_ca", self.tls_ca.as_ref()),
            ("tls_cert", self.tls_cert.as_ref()),
            ("tls_key", self.tls_key.as_ref()),
        ]
    }
}

/// The settings file as it was found.
#[derive(Debug)]
pub(crate) struct Settings {
    path: Option<PathBuf>,
    file: File,
    exists: bool,
    problem: Option<String>,
    /// Where each setting comes from, once the command line was read.
    sources: BTreeMap<&'static str, &'static str>,
}

impl Settings {
    /// Reads the file, if there is one. [`Settings::problem`] reports a wrong one.
    pub(crate) fn read() -> Self {
        let named = std::env::var_os(VARIABLE).filter(|name| !name.is_empty()).map(PathBuf::from);
        let path = named.clone().or_else(|| files::config_folder().map(|folder| folder.join(NAME)));
        let mut settings = Self {
            path: path.clone(),
            file: File::default(),
            exists: false,
            problem: None,
            sources: BTreeMap::new(),
        };
        let Some(path) = path else { return settings };
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                settings.exists = true;
                match parse(&text) {
                    Ok(file) => settings.file = file,
                    Err(problem) => settings.problem = Some(format!("{}: {problem}", path.display())),
                }
            }
            Err(error) if named.is_none() && error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => settings.problem = Some(format!("{}: {error}", path.display())),
        }
        settings
    }

    /// The fault in the file, if it has one.
    pub(crate) fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// Where the file is.
    pub(crate) fn place(&self) -> String {
        match &self.path {
            Some(path) if self.exists => path.display().to_string(),
            Some(path) => format!("no file {}", path.display()),
            None => "no place for a file: HOME is not set".to_owned(),
        }
    }

    /// Reads the command line with the file's settings as defaults.
    pub(crate) fn arguments<I, T>(&mut self, from: I) -> Result<Arguments, clap::Error>
    where
        I: IntoIterator<Item = T>,
        T: Into<std::ffi::OsString> + Clone,
    {
        let mut command = Arguments::command();
        for (name, value) in self.file.entries() {
            if let Some(value) = value.cloned() {
                command = command.mut_arg(name, |argument| argument.default_value(value));
            }
        }
        let matches = without_empty_variables(command).try_get_matches_from(from)?;
        self.note_sources(&matches);
        let mut arguments = Arguments::from_arg_matches(&matches)?;
        self.leave_out_tls(&matches, &mut arguments);
        Ok(arguments)
    }

    /// Leaves out TLS settings that the address overrules.
    fn leave_out_tls(&mut self, matches: &ArgMatches, arguments: &mut Arguments) {
        if !overrules_tls(matches) {
            return;
        }
        let CredentialArguments { tls_ca, tls_cert, tls_key, .. } = &mut arguments.credentials;
        for (name, path) in TLS_ARGUMENTS.into_iter().zip([tls_ca, tls_cert, tls_key]) {
            if path.take().is_some() {
                self.sources.insert(name, "left out, as the address has no TLS");
            }
        }
    }

    fn note_sources(&mut self, matches: &ArgMatches) {
        for (name, value) in self.file.entries() {
            let source = match matches.value_source(name) {
                Some(ValueSource::CommandLine) => "the command line",
                Some(ValueSource::EnvVariable) => "the environment",
                Some(_) if value.is_some() => "the file",
                Some(_) => "built in",
                None => "not set",
            };
            self.sources.insert(name, source);
        }
    }

    /// `config show`.
    pub(crate) fn show(&self, arguments: &Arguments, json: bool) -> Result<String, Failure> {
        let path = |path: &Option<PathBuf>| path.as_ref().map(|path| path.display().to_string());
        let credentials = &arguments.credentials;
        let values = [
            ("server", arguments.server.clone()),
            ("timeout", Some(humantime::format_duration(arguments.timeout).to_string())),
            ("token_file", path(&credentials.token_file)),
            ("tls_ca", path(&credentials.tls_ca)),
            ("tls_cert", path(&credentials.tls_cert)),
            ("tls_key", path(&credentials.tls_key)),
        ];
        let entry = |(name, value): &(&'static str, Option<String>)| {
            let source = self.sources.get(name).copied().unwrap_or("not set");
            (*name, serde_json::json!({ "value": value, "from": source }))
        };
        let record: BTreeMap<_, _> = values.iter().map(entry).collect();
        crate::output::either(json, &record, || {
            let mut text = format!("# {}\n", self.place());
            for (name, value) in &values {
                let source = self.sources.get(name).copied().unwrap_or("not set");
                text += &match value {
                    Some(value) => format!("{name} = {value:?}  # {source}\n"),
                    None => format!("# {name}: {source}\n"),
                };
            }
            text
        })
    }

    /// `config check`.
    pub(crate) fn check(&self, json: bool) -> Result<String, Failure> {
        if let Some(problem) = &self.problem {
            return Err(Failure::Data(problem.clone()));
        }
        let record = serde_json::json!({ "path": self.path, "exists": self.exists });
        crate::output::either(json, &record, || format!("{}: nothing is wrong", self.place()))
    }
}

fn parse(text: &str) -> Result<File, String> {
    let file: File = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
    if let Some(time) = &file.timeout {
        humantime::parse_duration(time).map_err(|error| format!("timeout = {time:?}: {error}"))?;
    }
    if file.tls_cert.is_some() != file.tls_key.is_some() {
        return Err("tls_cert and tls_key go together".into());
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(text: &str) -> Settings {
        Settings {
            path: None,
            file: parse(text).expect("settings"),
            exists: true,
            problem: None,
            sources: BTreeMap::new(),
        }
    }

    #[test]
    fn arguments_go_before_the_file() {
        let mut settings = settings("server = \"http://a:1\"\ntimeout = \"7s\"\n");
        let read = settings.arguments(["treewright", "ping", "--timeout", "9s"]).expect("arguments");
        assert_eq!(read.server.as_deref(), Some("http://a:1"));
        assert_eq!(read.timeout.as_secs(), 9);
        assert_eq!(
            (settings.sources["server"], settings.sources["timeout"]),
            ("the file", "the command line")
        );
        assert_eq!(settings.sources["tls_ca"], "not set");
    }

    #[test]
    fn tls_settings_are_left_out_where_an_address_without_tls_overrules_theirs() {
        let read = |more: &[&str]| {
            let mut found =
                settings("server = \"https://a:1\"\ntls_ca = \"c\"\ntls_cert = \"d\"\ntls_key = \"e\"\n");
            let line = ["treewright", "ping"].iter().chain(more).copied();
            let credentials = found.arguments(line).expect("arguments").credentials;
            let given = [credentials.tls_ca, credentials.tls_cert, credentials.tls_key];
            (given.map(|path| path.is_some()), found.sources["tls_ca"])
        };
        assert_eq!(read(&[]), ([true; 3], "the file"));
        assert_eq!(read(&["--server", "https://b:1"]), ([true; 3], "the file"));
        let left_out = ([false; 3], "left out, as the address has no TLS");
        for url in ["http://b:1", "unix:/run/a.sock,http://b:1", "local"] {
            assert_eq!(read(&["--server", url]), left_out, "{url}");
        }
        // A user who gives one with the address means this daemon, and gets an error.
        let given = read(&["--server", "http://b:1", "--tls-ca", "f"]);
        assert_eq!(given, ([true; 3], "the command line"));
    }

    #[test]
    fn mistakes_are_named() {
        assert!(parse("sever = \"x\"").expect_err("a mistake").contains("sever"));
        assert!(parse("timeout = \"soon\"").expect_err("a mistake").contains("soon"));
        assert!(parse("tls_cert = \"a\"").expect_err("a mistake").contains("go together"));
    }
}
