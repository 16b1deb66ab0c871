//! The dashboard: studies, tuning curves, trials and reasons as pages for a browser, on a port of their own.
//!
//! Pages are made on the server and work without scripts. A small script fetches a page again when an event
//! of the server says that its study has changed. Everything comes from this port, and the content security
//! policy allows nothing else. Pages ask through the handlers of the RPCs, with the caller of the token that
//! the browser shows, and the database answers readers beside the writer. Only forms of [`steering`] change a
//! study. The data behind a page has limits, so that a study of many trials opens as fast as one of few.

mod benefit;
mod charts;
mod pages;
mod query;
mod stats;
mod steering;

use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use http::{HeaderMap, HeaderValue, Method, Request, Response, StatusCode, header};
use http_body_util::combinators::BoxBody;
use http_body_util::{BodyExt, Full, Limited, StreamBody};
use hyper::body::{Frame, Incoming};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;
use tracing::Instrument as _;
use treewright_proto::v1;

use crate::access::caller::Caller;
use crate::access::rules::Need;
use crate::access::{Access, Authorization};
use crate::config::DashboardPeer;
use crate::connections::ConnectionSlot;
use crate::connections::pages::Pages;
use crate::error::{Error, Result};
use crate::refusals::Refusals;
use crate::rpc::Call;
use crate::tuning::Tuning;
use crate::{limits, rpc, status};
use pages::{PageFrame, StudyIndex};
use query::Query;
use steering::{Steered, SteeringForm};
use treewright_store::StoreError;
use treewright_store::tokens::Scope;

const HTML: &str = "text/html; charset=utf-8";
/// All content from this port, none inline, and no framing.
const POLICY: &str = "default-src 'none'; style-src 'self'; script-src 'self'; connect-src 'self'; img-src 'self' \
                      data:; form-action 'self'; base-uri 'none'; frame-ancestors 'none'";
/// How often a visitor waits for a study that is being read into memory; each time is up to a second.
const LOADING_WAITS: u32 = 20;
/// The answer to a form of another site.
const FOREIGN: Error = Error::Denied("the form does not come from a page of this dashboard");
const COOKIE: &str = "treewright_token";

type Body = BoxBody<Bytes, Infallible>;

pub(crate) struct Dashboard {
    tuning: Arc<Tuning>,
    /// Without it no token is required.
    access: Option<Arc<Access>>,
    refusals: Refusals,
    index: StudyIndex,
}

pub(super) struct Visitor<'a> {
    tuning: &'a Tuning,
    caller: &'a Caller,
    frame: PageFrame,
}

impl<'a> Visitor<'a> {
    fn call(&self) -> Call<'a> {
        Call { tuning: self.tuning, caller: self.caller }
    }
}

impl Dashboard {
    /// The pages of a daemon. Its list of studies holds those of other daemons, too.
    pub(crate) fn new(
        tuning: Arc<Tuning>,
        access: Option<Arc<Access>>,
        refusals: Refusals,
        peers: Vec<DashboardPeer>,
    ) -> Self {
        let index = StudyIndex::new(Arc::clone(&tuning), peers);
        Self { tuning, access, refusals, index }
    }

    async fn respond(self: &Arc<Self>, request: Request<Incoming>, slot: &ConnectionSlot) -> Response<Body> {
        let (parts, body) = request.into_parts();
        if self.access.is_none() && !names_this_machine(&parts.headers) {
            // Otherwise a page of the Internet could point its name here, and read data that no token guards.
            return text(StatusCode::MISDIRECTED_REQUEST, "ask by address or as localhost\n".to_owned());
        }
        let path = parts.uri.path();
        match (&parts.method, path) {
            (&Method::GET | &Method::HEAD, "/style.css") => {
                asset("text/css; charset=utf-8", include_str!("../../assets/style.css"))
            }
            (&Method::GET | &Method::HEAD, "/live.js") => {
                asset("text/javascript; charset=utf-8", include_str!("../../assets/live.js"))
            }
            (&Method::GET | &Method::HEAD, "/login") => page(StatusCode::OK, pages::login(None)),
            (&Method::POST, "/login" | "/logout") if steering::is_foreign_form(&parts.headers) => {
                failure(PageFrame { has_token: false }, &FOREIGN)
            }
            (&Method::POST, "/login") => self.log_in(body, slot).await,
            (&Method::POST, "/logout") => redirect("/login", Some(cookie("", true))),
            (&Method::POST, _) => self.steer(path, &parts.headers, body, slot).await,
            (&Method::GET | &Method::HEAD, _) => {
                let query = Query::read(parts.uri.query().unwrap_or_default());
                self.look(path, &query, &parts.headers, slot).await
            }
            _ => text(StatusCode::METHOD_NOT_ALLOWED, "only GET\n".to_owned()),
        }
    }

    /// Admits a visitor whose token may read.
    async fn authorize(&self, authorization: Authorization<'_>) -> Result<Caller> {
        match &self.access {
            None => Ok(Caller::Anyone),
            Some(access) => access.authorize(Need::Scope(Scope::Read), authorization).await,
        }
    }

    async fn log_in(&self, body: Incoming, slot: &ConnectionSlot) -> Response<Body> {
        let form = match read_form(body).await {
            Ok(form) => form,
            Err(refused) => return refused,
        };
        let token = form.text("token");
        match self.authorize(Authorization::Bearer(token.trim())).await {
            Ok(_) => {
                slot.settle();
                redirect("/", Some(cookie(token.trim(), false)))
            }
            Err(error) => {
                self.refusals.note(&error);
                page(StatusCode::UNAUTHORIZED, pages::login(Some(error.to_string())))
            }
        }
    }

    /// Admits a request for a page, and counts it.
    async fn enter(&self, path: &str, headers: &HeaderMap) -> Result<Caller> {
        let kept = token_of(headers);
        let authorization = match &kept {
            Some(token) => Authorization::Bearer(token),
            None => Authorization::of(headers),
        };
        let caller = self.authorize(authorization).await.inspect_err(|error| {
            // A browser without a token only gets the page to log in.
            if !matches!(authorization, Authorization::Missing) {
                self.refusals.note(error);
            }
        })?;
        tracing::Span::current().record("token", caller.id());
        caller.spend_request(path.len()).inspect_err(|error| self.refusals.note(error))?;
        Ok(caller)
    }

    async fn look(
        self: &Arc<Self>,
        path: &str,
        query: &Query,
        headers: &HeaderMap,
        slot: &ConnectionSlot,
    ) -> Response<Body> {
        let caller = match self.enter(path, headers).await {
            Ok(caller) => caller,
            Err(Error::Unauthenticated(_)) => return redirect("/login", None),
            Err(error) => return failure(PageFrame { has_token: true }, &error),
        };
        slot.settle();
        let frame = PageFrame { has_token: self.access.is_some() };
        let visitor = Visitor { tuning: &self.tuning, caller: &caller, frame };
        let parts: Vec<&str> = path.split('/').filter(|part| !part.is_empty()).collect();
        let made = match *parts.as_slice() {
            [] => self.index.page(&visitor, query).await,
            ["studies.json"] => match self.index.json(&visitor, query).await {
                Ok(json) => return of(StatusCode::OK, "application/json", json),
                Err(error) => Err(error),
            },
            ["compare"] => pages::compare(&visitor, query).await,
            ["events"] => return self.events(caller, None),
            ["studies", id] => pages::study(&visitor, id, query).await,
            ["studies", id, "events"] => return self.events(caller, Some(id.to_owned())),
            ["studies", id, "front"] => pages::front(&visitor, id, query).await,
            ["studies", id, "map"] => pages::map(&visitor, id, query).await,
            ["studies", id, "parameters"] => pages::parameters(&visitor, id, query).await,
            ["studies", id, "policy"] => pages::policy(&visitor, id, query).await,
            ["studies", id, "trials"] => match pages::trials(&visitor, id, query).await {
                Ok((html, false)) => return page(StatusCode::BAD_REQUEST, Ok(html)),
                answer => answer.map(|(html, _)| html),
            },
            ["studies", id, "trials", number] => pages::trial(&visitor, id, number, query).await,
            _ => {
                return page(
                    StatusCode::NOT_FOUND,
                    pages::problem(frame, "Not found", "There is no such page."),
                );
            }
        };
        match made {
            Ok(html) => page(StatusCode::OK, Ok(html)),
            Err(error) => failure(frame, &error),
        }
    }

    /// Changes a study, and redirects to a page that shows it.
    async fn steer(
        &self,
        path: &str,
        headers: &HeaderMap,
        body: Incoming,
        slot: &ConnectionSlot,
    ) -> Response<Body> {
        let parts: Vec<&str> = path.split('/').filter(|part| !part.is_empty()).collect();
        let Some((study, asked)) = SteeringForm::at(&parts) else {
            return text(StatusCode::METHOD_NOT_ALLOWED, "only GET\n".to_owned());
        };
        let frame = PageFrame { has_token: self.access.is_some() };
        let caller = match self.enter(path, headers).await {
            Ok(caller) => caller,
            Err(Error::Unauthenticated(_)) => return redirect("/login", None),
            Err(error) => return failure(frame, &error),
        };
        slot.settle();
        if !steering::is_own_form(headers) {
            return failure(frame, &FOREIGN);
        }
        let form = match read_form(body).await {
            Ok(form) => form,
            Err(refused) => return refused,
        };
        let visitor = Visitor { tuning: &self.tuning, caller: &caller, frame };
        match asked.steer(&visitor, study, &form).await {
            Ok(Steered::Changed(page)) => redirect(&page, None),
            Ok(Steered::Elsewhere(advice)) => {
                page(StatusCode::SERVICE_UNAVAILABLE, pages::problem(frame, "Not from here", &advice))
            }
            Err(error) => failure(frame, &error),
        }
    }

    /// An event for each change of a study, or of the list of studies, until the browser disconnects or the
    /// token ends.
    fn events(self: &Arc<Self>, caller: Caller, study: Option<String>) -> Response<Body> {
        let (events, stream) = mpsc::channel(1);
        let dashboard = Arc::clone(self);
        tokio::spawn(async move {
            let mut last = None;
            loop {
                let Ok(now) = dashboard.moment(&caller, study.as_deref()).await else { break };
                let is_change = last.as_ref().is_some_and(|last| *last != now);
                // A comment keeps the connection alive, and shows whether the browser is still there.
                let event = if is_change { "event: change\ndata:\n\n" } else { ":\n\n" };
                last = Some(now);
                if events.send(Ok(Frame::data(Bytes::from_static(event.as_bytes())))).await.is_err() {
                    break;
                }
                tokio::time::sleep(limits::DASHBOARD_LOOK).await;
            }
        });
        let mut response = Response::new(BodyExt::boxed(StreamBody::new(ReceiverStream::new(stream))));
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
        guarded(response)
    }

    /// The counts of the study, or those of the listed studies and of changes of their summaries, which
    /// change with every event.
    async fn moment(
        &self,
        caller: &Caller,
        study: Option<&str>,
    ) -> Result<(Vec<Option<v1::StudyStatistics>>, u64)> {
        caller.may(Scope::Read)?;
        let call = Call { tuning: &self.tuning, caller };
        Ok(match study {
            Some(id) => {
                let request = v1::GetStudyRequest { name: format!("studies/{id}") };
                (vec![rpc::studies::get(call, request).await?.statistics], 0)
            }
            None => {
                let answer = rpc::studies::list(call, v1::ListStudiesRequest::default()).await?;
                let counts = answer.studies.into_iter().map(|study| study.statistics);
                (counts.collect(), self.index.changes())
            }
        })
    }
}

/// Whether nothing was done because the study was not in memory: the request is worth repeating at once.
fn is_loading(error: &Error) -> bool {
    matches!(error, Error::Loading { .. } | Error::Reloading { .. } | Error::Store(StoreError::Fenced { .. }))
}

async fn read_form(body: Incoming) -> Result<Query, Response<Body>> {
    let form = Limited::new(body, limits::DASHBOARD_FORM_BYTES).collect();
    match tokio::time::timeout(limits::WATCH, form).await {
        Ok(Ok(body)) => Ok(Query::read(&String::from_utf8_lossy(&body.to_bytes()))),
        Ok(Err(_)) => Err(text(StatusCode::PAYLOAD_TOO_LARGE, "too much\n".to_owned())),
        Err(_) => Err(text(StatusCode::REQUEST_TIMEOUT, "too slow\n".to_owned())),
    }
}

/// Whether a request names the machine by its address, or as localhost.
fn names_this_machine(headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(header::HOST).and_then(|host| host.to_str().ok()) else { return false };
    let name =
        host.rsplit_once(':').map_or(host, |(name, port)| if port.ends_with(']') { host } else { name });
    name == "localhost"
        || host.parse::<SocketAddr>().is_ok()
        || name.trim_matches(['[', ']']).parse::<IpAddr>().is_ok()
}

/// The token that the browser keeps.
fn token_of(headers: &HeaderMap) -> Option<String> {
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = cookies.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == COOKIE).map(|(_, token)| token.to_owned())
}

/// The cookie that keeps a token until the browser is closed, or ends it.
fn cookie(token: &str, ends: bool) -> String {
    let age = if ends { "; Max-Age=0" } else { "" };
    format!("{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict{age}")
}

fn full(text: impl Into<Bytes>) -> Body {
    BodyExt::boxed(Full::new(text.into()))
}

fn guarded(mut response: Response<Body>) -> Response<Body> {
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        // Other sites get no address, and forms of these pages name their origin.
        (header::REFERRER_POLICY, "same-origin"),
        (header::X_FRAME_OPTIONS, "DENY"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

fn of(status: StatusCode, kind: &'static str, body: impl Into<Bytes>) -> Response<Body> {
    let mut response = Response::new(full(body));
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    guarded(response)
}

fn text(status: StatusCode, text: String) -> Response<Body> {
    of(status, "text/plain; charset=utf-8", text)
}

fn asset(kind: &'static str, content: &'static str) -> Response<Body> {
    let mut response = of(StatusCode::OK, kind, content);
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("max-age=300"));
    response
}

fn page(status: StatusCode, html: Result<String>) -> Response<Body> {
    match html {
        Ok(html) => of(status, HTML, html),
        Err(error) => text(StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")),
    }
}

fn redirect(to: &str, cookie: Option<String>) -> Response<Body> {
    let mut response = text(StatusCode::SEE_OTHER, String::new());
    // Ids of studies are letters, digits and hyphens, so this is never refused.
    let to = HeaderValue::try_from(to).unwrap_or(HeaderValue::from_static("/"));
    response.headers_mut().insert(header::LOCATION, to);
    // A token that is no header value was refused before.
    if let Some(cookie) = cookie.and_then(|cookie| HeaderValue::try_from(cookie).ok()) {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    response
}

fn failure(frame: PageFrame, error: &Error) -> Response<Body> {
    let (status, title) = match status::code(error) {
        Code::NotFound => (StatusCode::NOT_FOUND, "Not found"),
        Code::PermissionDenied => (StatusCode::FORBIDDEN, "Not allowed"),
        Code::InvalidArgument => (StatusCode::BAD_REQUEST, "Cannot be read"),
        Code::FailedPrecondition => (StatusCode::CONFLICT, "Not possible"),
        Code::ResourceExhausted if matches!(error, Error::Quota { .. }) => {
            (StatusCode::TOO_MANY_REQUESTS, "Not now")
        }
        Code::Unavailable | Code::ResourceExhausted => (StatusCode::SERVICE_UNAVAILABLE, "Not now"),
        _ => (StatusCode::INTERNAL_SERVER_ERROR, "Failed"),
    };
    let mut answer = page(status, pages::problem(frame, title, &error.to_string()));
    if let Some(wait) = status::retry_after(error) {
        // In whole seconds, and never too soon.
        let wait_s = wait.as_secs_f64().ceil().max(1.0) as u64;
        answer.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(wait_s));
    }
    answer
}

impl Pages for Dashboard {
    type Body = Body;

    const KEEPS_ALIVE: bool = true;
    const STAY: Duration = limits::DASHBOARD_STAY;

    async fn answer(self: &Arc<Self>, request: Request<Incoming>, slot: &ConnectionSlot) -> Response<Body> {
        let span = tracing::info_span!("request", rpc = "dashboard", token = tracing::field::Empty);
        self.respond(request, slot).instrument(span).await
    }
}

/// Whether the caller may change studies here. Where no token is asked for nobody may: a proxy in front of
/// the pages would let everybody steer whom it lets look.
fn may_steer(caller: &Caller) -> bool {
    match caller {
        Caller::Anyone => false,
        Caller::Holder(_) => caller.may(Scope::Admin).is_ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_machine_is_asked_without_a_token() {
        let asked = |host: &'static str| {
            names_this_machine(&[(header::HOST, HeaderValue::from_static(host))].into_iter().collect())
        };
        for good in ["localhost:1", "127.0.0.1:8080", "[::1]:8080", "[::1]", "10.0.0.7:1", "localhost"] {
            assert!(asked(good), "{good}");
        }
        for bad in ["evil.example", "evil.example:8080", "localhost.evil.example:1", ""] {
            assert!(!asked(bad), "{bad}");
        }
        assert!(!names_this_machine(&HeaderMap::new()));
    }

    #[test]
    fn a_kept_token_is_found_among_cookies() {
        let headers = |line: &'static str| -> HeaderMap {
            [(header::COOKIE, HeaderValue::from_static(line))].into_iter().collect()
        };
        assert_eq!(token_of(&headers("a=b; treewright_token=tw1_x; c=d")).as_deref(), Some("tw1_x"));
        assert_eq!(token_of(&headers("other=tw1_x")), None);
    }
}
