//! The parts that all handles of one client share: channel, state of the connection, outbox, counts.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tonic::service::interceptor::InterceptedService;
use tonic::transport::Endpoint;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;

use crate::attach::Attach;
use crate::back_off::BackOff;
use crate::circuit_breaker::{CircuitBreaker, Status};
use crate::failover::Failover;
use crate::locks::lock;
use crate::outbox::{Lost, Outbox};
use crate::prepared::SetUps;
use crate::stats::Counters;
use crate::workers::Workers;
use crate::{ClientError, Credentials, Options, limits, wire};

/// The connection, with what goes along with every call.
pub(crate) type Connection = InterceptedService<Failover, Attach>;

/// Shared by a client, its studies and their suggestions.
#[derive(Debug)]
pub(crate) struct Core {
    pub(crate) url: String,
    pub(crate) options: Options,
    pub(crate) circuit_breaker: CircuitBreaker,
    pub(crate) outbox: Arc<Outbox>,
    pub(crate) counters: Counters,
    /// The workers, by their names for the service.
    pub(crate) workers: Arc<Workers>,
    /// Distinguishes this client from an earlier one of its id.
    pub(crate) session: u64,
    /// For what is done in the background of calls that do not wait.
    pub(crate) runtime: tokio::runtime::Handle,
    /// By study.
    set_ups: Mutex<HashMap<Arc<str>, Arc<SetUps>>>,
    process: u32,
    channel: Failover,
    attach: Attach,
}

impl Core {
    /// Makes the channel without connecting it. Must run inside a tokio runtime.
    pub(crate) fn new(url: &str, options: Options) -> Result<Self, ClientError> {
        options.check()?;
        let session = new_session();
        let attach = Attach::new(options.credentials.bearer(), session);
        let channels = endpoints(url, &options.credentials)?.into_iter().map(|endpoint| {
            endpoint
                .connect_timeout(limits::CONNECT)
                .tcp_nodelay(true)
                .http2_keep_alive_interval(Duration::from_secs(10))
                .keep_alive_timeout(Duration::from_secs(5))
                .connect_lazy()
        });
        let channel = Failover::new(channels.collect());
        Ok(Self {
            url: url.to_owned(),
            circuit_breaker: CircuitBreaker::new(),
            outbox: Arc::new(Outbox::new(options.queue)),
            counters: Counters::default(),
            workers: Arc::new(Workers::new(&options.client_id, url)),
            session,
            runtime: tokio::runtime::Handle::current(),
            set_ups: Mutex::default(),
            process: std::process::id(),
            channel,
            attach,
            options,
        })
    }

    /// False in the child of a fork, where nothing may be said and no lock be taken in the parent's name.
    pub(crate) fn is_of_this_process(&self) -> bool {
        self.process == std::process::id()
    }

    /// The program's set-up for a study, by whichever handle.
    pub(crate) fn set_ups(&self, study: &Arc<str>) -> Arc<SetUps> {
        let mut all = lock(&self.set_ups);
        Arc::clone(all.entry(Arc::clone(study)).or_default())
    }

    fn connection(&self) -> Connection {
        InterceptedService::new(self.channel.clone(), self.attach.clone())
    }

    /// The generated client, on the shared connection.
    pub(crate) fn rpc(&self) -> TuningServiceClient<Connection> {
        TuningServiceClient::new(self.connection()).max_decoding_message_size(limits::ANSWER_BYTES)
    }

    pub(crate) fn back_off(&self) -> BackOff {
        BackOff::new(&self.options)
    }

    /// Looks for a daemon that serves: at another address first, where the one in use has failed.
    pub(crate) async fn look_for_daemon(&self) -> Result<(), ClientError> {
        if matches!(self.circuit_breaker.status(), Status::Away { .. }) {
            self.channel.distrust();
        }
        // One address after the other may have to run out of time.
        let addresses = u32::try_from(self.channel.count()).unwrap_or(u32::MAX);
        self.probe(limits::PROBE.saturating_mul(addresses + 1)).await
    }

    /// Asks the daemon again and again whether it serves, with this pause; without one it only waits.
    pub(crate) async fn keep_awake(&self, pause: Option<Duration>) {
        let Some(pause) = pause else { return std::future::pending().await };
        loop {
            tokio::time::sleep(pause).await;
            // A daemon that does not answer is looked for elsewhere.
            let _ = self.probe(limits::PROBE).await;
        }
    }

    /// Pauses between looking for the daemon.
    pub(crate) fn looking_back_off(&self) -> BackOff {
        if self.channel.count() > 1 { self.back_off().sooner() } else { self.back_off() }
    }

    /// Makes one call within a time limit and learns from it whether the daemon is there.
    pub(crate) async fn call<T>(
        &self,
        name: &'static str,
        limit: Duration,
        rpc: impl Future<Output = Result<tonic::Response<T>, tonic::Status>>,
    ) -> Result<T, ClientError> {
        let result = match tokio::time::timeout(limit, rpc).await {
            Ok(Ok(response)) => Ok(response.into_inner()),
            Ok(Err(status)) => Err(ClientError::from_status(&self.url, name, &status)),
            Err(_) => Err(self.late(name, limit)),
        };
        match &result {
            Err(problem) if problem.is_unreachable() => {
                self.circuit_breaker.failure(Arc::new(problem.clone()))
            }
            Ok(_) => self.circuit_breaker.success(),
            Err(problem) => {
                self.circuit_breaker.success();
                self.circuit_breaker.note_hint(problem);
            }
        }
        result
    }

    /// The answer of `ask`. It is asked again within the time limit while the daemon is still loading the
    /// study and says when it may serve. At the end of the limit the daemon's own words come back.
    pub(crate) async fn until_ready<T, F>(
        &self,
        name: &'static str,
        limit: Duration,
        mut ask: impl FnMut() -> F,
    ) -> Result<T, ClientError>
    where
        F: Future<Output = Result<T, ClientError>>,
    {
        let mut not_yet = None;
        let asked = async {
            loop {
                let problem = match ask().await {
                    Ok(answer) => return Ok(answer),
                    Err(problem) => problem,
                };
                let Some(wait) = problem.retry_after().filter(|_| problem.is_unreachable()) else {
                    return Err(problem);
                };
                not_yet = Some(problem);
                self.back_off().sleep_at_least(1, Some(wait)).await;
            }
        };
        match tokio::time::timeout(limit, asked).await {
            Ok(result) => result,
            Err(_elapsed) => Err(not_yet.unwrap_or_else(|| {
                let late = self.late(name, limit);
                self.circuit_breaker.failure(Arc::new(late.clone()));
                late
            })),
        }
    }

    /// Asks the daemon's health service whether it serves.
    pub(crate) async fn probe(&self, limit: Duration) -> Result<(), ClientError> {
        let request = HealthCheckRequest { service: String::new() };
        let mut client = HealthClient::new(self.connection());
        match tokio::time::timeout(limit, client.check(request)).await {
            Ok(Ok(response)) if response.get_ref().status() == ServingStatus::Serving => Ok(()),
            Ok(Ok(_)) => Err(ClientError::away(&self.url, "it is not serving at the moment")),
            Ok(Err(status)) => match ClientError::from_status(&self.url, "Check", &status) {
                // A server without a health service answers: that is good enough to send requests.
                ClientError::Refused { code: tonic::Code::Unimplemented, .. } => Ok(()),
                problem => Err(problem),
            },
            Err(_) => Err(self.late("Check", limit)),
        }
    }

    pub(crate) fn late(&self, call: &'static str, deadline: Duration) -> ClientError {
        ClientError::Late { url: self.url.clone(), call, deadline }
    }

    pub(crate) fn malformed(&self, call: &'static str, problem: wire::Problem) -> ClientError {
        let problem = ClientError::Malformed { call, problem };
        self.counters.note(&problem);
        problem
    }

    pub(crate) fn count_lost(&self, lost: Lost) {
        self.counters.dropped.add(lost.reports);
        self.counters.abandons_dropped.add(lost.abandons);
        if lost.reports > 0 {
            self.counters.note(format!(
                "{} report(s) were dropped, because the queue is full or closed",
                lost.reports
            ));
        }
    }

    /// Waits until every report is acknowledged or refused.
    pub(crate) async fn flush(&self, deadline: Duration) -> Result<(), ClientError> {
        let quiet = tokio::time::timeout(deadline, self.outbox.wait_until_quiet()).await;
        let waiting = self.outbox.waiting();
        if quiet.is_ok() || waiting == 0 {
            return Ok(());
        }
        let last = self.circuit_breaker.problem().map(|problem| problem.to_string());
        let last = last.or_else(|| self.counters.last_error());
        Err(ClientError::Unflushed { waiting, deadline, last: last.unwrap_or_else(|| "none".into()) })
    }
}

/// A number that is new with every client: the time in nanoseconds, which with the process number below it
/// differs even for two that start at once. Never 0.
fn new_session() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    (now.as_nanos() as u64).wrapping_add(u64::from(std::process::id())).max(1)
}

/// Reads one address, or several that are parted by commas.
fn endpoints(urls: &str, credentials: &Credentials) -> Result<Vec<Endpoint>, ClientError> {
    let addresses: Vec<&str> = urls.split(',').map(str::trim).collect();
    if addresses.len() > limits::ADDRESSES {
        let reason =
            format!("it names {} addresses, and {} are the most", addresses.len(), limits::ADDRESSES);
        return Err(ClientError::BadUrl { url: urls.to_owned(), reason });
    }
    addresses.into_iter().map(|url| endpoint(url, credentials)).collect()
}

/// Checks more than the HTTP library does, which takes any word for an address.
fn endpoint(url: &str, credentials: &Credentials) -> Result<Endpoint, ClientError> {
    let bad = |reason: String| ClientError::BadUrl { url: url.to_owned(), reason };
    if let Some(path) = url.strip_prefix("unix:") {
        let path = path.strip_prefix("//").unwrap_or(path);
        if !path.starts_with('/') {
            return Err(bad(
                "it names no whole path; write it like unix:/run/user/1000/treewright/daemon.sock".into(),
            ));
        }
        // Only its two ends can read a Unix socket, so a token may be sent through it.
        return Endpoint::from_shared(format!("unix:{path}"))
            .map_err(|error| bad(crate::error::innermost(&error)));
    }
    let Some((scheme @ ("http" | "https"), rest)) = url.split_once("://") else {
        let remedy = match url.rsplit_once(':') {
            // `localhost:50611` as other programs take it.
            Some((host, port)) if !host.contains('/') && !host.is_empty() && port.parse::<u16>().is_ok() => {
                format!("; http://{url} is it in plain text, https://{url} with TLS")
            }
            _ => String::new(),
        };
        return Err(bad(format!("it begins with none of http://, https:// and unix:{remedy}")));
    };
    if rest.is_empty() || rest.starts_with(['/', ':']) {
        return Err(bad("it names no host".into()));
    }
    let endpoint =
        Endpoint::from_shared(url.to_owned()).map_err(|error| bad(crate::error::innermost(&error)))?;
    let uri = endpoint.uri();
    let port_is_missing_or_fits = uri.authority().is_some_and(|all| !all.as_str().ends_with(':')) && {
        let after_host =
            uri.authority().map_or("", |all| &all.as_str()[all.as_str().rfind(']').unwrap_or(0)..]);
        after_host.rsplit_once(':').is_none_or(|(_, port)| port.parse::<u16>().is_ok())
    };
    if !port_is_missing_or_fits {
        return Err(bad("its port is not a number from 1 to 65535".into()));
    }
    if !matches!(uri.path(), "" | "/") {
        return Err(bad(format!("the path `{}` has no meaning here", uri.path())));
    }
    if scheme == "https" {
        let problem = |error| bad(format!("TLS cannot be set up: {}", crate::error::innermost(&error)));
        return endpoint.tls_config(credentials.tls()).map_err(problem);
    }
    if credentials.bearer().is_some() && !uri.host().is_some_and(is_here) {
        let problem = format!("it would travel to {url} in plain text; write https://{rest}");
        return Err(ClientError::invalid("token", problem));
    }
    if let Some(what) = credentials.only_for_tls() {
        let problem =
            format!("it is only used with TLS, and {url} has none; write https://{rest}, or leave it out");
        return Err(ClientError::invalid(what, problem));
    }
    Ok(endpoint)
}

/// Whether a host is this machine.
fn is_here(host: &str) -> bool {
    let address = host.trim_matches(['[', ']']).parse::<std::net::IpAddr>();
    host == "localhost" || address.is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_addresses_are_parted_by_commas() {
        let count = |urls: &str| {
            endpoints(urls, &Credentials::new()).map(|all| all.len()).map_err(|error| error.to_string())
        };
        assert_eq!(count("http://a:1"), Ok(1));
        assert_eq!(count("http://a:1, http://b:2,http://c:3"), Ok(3));
        assert!(count("http://a:1,").is_err());
        assert!(count("http://a:1,b:2").is_err_and(|text| text.starts_with("`b:2`")));
        assert!(count(&["http://a:1"; 17].join(",")).is_err_and(|text| text.contains("16 are the most")));
    }

    #[test]
    fn tokens_travel_encrypted_or_not_at_all() {
        let token = Credentials::new().token("tw1_1_2").unwrap();
        for good in ["http://127.0.0.1:1", "http://[::1]:1", "http://localhost:1"] {
            assert!(endpoint(good, &token).is_ok(), "{good}");
        }
        let refused = endpoint("http://render-farm:1", &token).err().map(|error| error.to_string());
        assert!(refused.is_some_and(|text| text.contains("https://") && !text.contains("tw1_1_2")));
    }

    #[test]
    fn nothing_that_needs_tls_is_unused_in_plain_text() {
        let empty = std::path::Path::new("/dev/null");
        for (what, credentials) in [
            ("client certificate", Credentials::new().certificate_files(empty, empty)),
            ("certificate authority", Credentials::new().authority_file(empty)),
            ("server name", Ok(Credentials::new().server_name("farm"))),
        ] {
            let credentials = credentials.unwrap();
            let words = |url: &str| endpoints(url, &credentials).err().map(|error| error.to_string());
            for url in ["http://localhost:1", "unix:/run/a.sock,http://localhost:1"] {
                let told = words(url).unwrap();
                assert!(told.starts_with(what) && told.contains("write https://localhost:1"), "{told}");
            }
            assert_eq!(words("unix:/run/a.sock"), None);
            assert!(!words("https://localhost:1").is_some_and(|told| told.contains("only used")));
        }
    }

    #[test]
    fn who_forgot_the_scheme_is_told() {
        let suggests_scheme = |url: &str| {
            let refused = endpoint(url, &Credentials::new()).err();
            refused.is_some_and(|error| error.to_string().contains(&format!("http://{url} is it")))
        };
        assert!(suggests_scheme("render-farm:50611"));
        for other in ["render-farm", "render-farm:port", ":50611", "a/b:50611"] {
            assert!(!suggests_scheme(other), "{other}");
        }
    }

    #[test]
    fn addresses_are_checked() {
        for good in [
            "http://127.0.0.1:50611",
            "http://[::1]:50611/",
            "http://render-farm",
            "unix:/run/a.sock",
            "unix:///run/a.sock",
        ] {
            assert!(endpoint(good, &Credentials::new()).is_ok(), "{good}");
        }
        for bad in [
            "",
            "here",
            "http://",
            "http://:50611",
            "ftp://x",
            "http://x:99999",
            "http://x:",
            "http://a b",
            "http://x/y",
            "unix:",
            "unix:a.sock",
        ] {
            let error = endpoint(bad, &Credentials::new()).err().map(|error| error.to_string());
            assert!(error.is_some_and(|text| text.contains("http://127.0.0.1:50611")), "{bad}");
        }
    }
}
