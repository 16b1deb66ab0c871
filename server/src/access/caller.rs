//! The sender of a request: any caller, where no tokens are required, or the holder of a token, with the
//! token's rights and quotas.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;

use tokio::time::Instant;
use treewright_store::StoreError;
use treewright_store::tokens::{Quota, Scope, TokenError, TokenRecord, Usage, day};

use super::rate::Rate;
use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::limits;

/// The sender of a request. Cheap to clone.
#[derive(Clone, Debug)]
pub enum Caller {
    /// No tokens are required.
    Anyone,
    /// The holder of a token.
    Holder(Arc<Holder>),
}

/// A token that was used since the daemon started. Its terms may change while streams are open.
pub struct Holder {
    pub(super) id: String,
    /// None once the token is forgotten.
    terms: RwLock<Option<Arc<TokenRecord>>>,
    rate: Rate,
    used: Mutex<Used>,
    seen: Arc<LastRead>,
    clock: Arc<dyn Clock>,
    /// Requests refused for a quota: the first and every thousandth are logged.
    refused: AtomicU64,
}

/// The usage of the token that this daemon knows.
#[derive(Clone, Copy, Debug, Default)]
struct Used {
    day: i64,
    all: Usage,
    today: Usage,
    /// The part of today's usage that is not stored yet.
    unsaved: Usage,
    /// Reserved usage counts against the quotas and is not stored.
    reserved: Usage,
}

impl Used {
    fn turn(&mut self, today: i64) {
        if self.day != today {
            *self = Self { day: today, today: Usage::default(), ..*self };
        }
    }

    fn add(&mut self, more: Usage) {
        for sum in [&mut self.all, &mut self.today, &mut self.unsaved] {
            sum.add(more);
        }
    }
}

impl Holder {
    pub(super) fn new(
        record: TokenRecord,
        used: (Usage, Usage),
        seen: Arc<LastRead>,
        clock: Arc<dyn Clock>,
    ) -> Self {
        let day = day(clock.now_ms());
        Self {
            id: record.id.clone(),
            terms: RwLock::new(Some(Arc::new(record))),
            rate: Rate::default(),
            used: Mutex::new(Used { day, all: used.0, today: used.1, ..Used::default() }),
            seen,
            clock,
            refused: AtomicU64::new(0),
        }
    }

    /// The present terms of a token that is still valid.
    pub(super) fn terms(&self) -> Result<Arc<TokenRecord>> {
        self.seen.check()?;
        let terms = self.terms.read().unwrap_or_else(PoisonError::into_inner).clone();
        let now_ms = self.clock.now_ms();
        match terms {
            Some(terms) if terms.is_live(now_ms) => Ok(terms),
            Some(terms) if terms.revoke_ms.is_none() => Err(Error::Unauthenticated("the token has expired")),
            _ => Err(Error::Unauthenticated("the token was revoked")),
        }
    }

    pub(super) fn stored(&self) -> Option<Arc<TokenRecord>> {
        self.terms.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether it has a quota in all or in a day.
    pub(super) fn is_limited(&self) -> bool {
        self.stored().is_some_and(|terms| Quota { requests_per_s: None, ..terms.quota } != Quota::default())
    }

    pub(super) fn replace(&self, terms: Option<TokenRecord>) {
        assert!(terms.as_ref().is_none_or(|terms| terms.id == self.id), "{} gets another's terms", self.id);
        *self.terms.write().unwrap_or_else(PoisonError::into_inner) = terms.map(Arc::new);
    }

    /// Takes the usage that is not stored yet, with its day.
    pub(super) fn take_unsaved(&self) -> Option<(i64, Usage)> {
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let unsaved = std::mem::take(&mut used.unsaved);
        (unsaved != Usage::default()).then_some((used.day, unsaved))
    }

    /// Puts back usage that could not be stored. Usage of a past day counts for the new one.
    pub(super) fn put_back(&self, unsaved: Usage) {
        self.used.lock().unwrap_or_else(PoisonError::into_inner).unsaved.add(unsaved);
    }

    /// Takes over the stored usage of all replicas, this one included.
    pub(super) fn learn(&self, day: i64, (mut all, mut today): (Usage, Usage)) {
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        if used.day == day {
            all.add(used.unsaved);
            today.add(used.unsaved);
            *used = Used { all, today, ..*used };
        }
    }

    /// Adds to the usage, or to the reserved usage of a request that may fail, where the quota allows it.
    fn spend(&self, more: Usage, reserve: bool) -> Result<()> {
        let quota = self.terms()?.quota;
        let now_ms = self.clock.now_ms();
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let used = &mut *used;
        let today = day(now_ms);
        used.turn(today);
        let (mut all, mut of_today) = (used.all, used.today);
        all.add(used.reserved);
        of_today.add(used.reserved);
        let tomorrow = Duration::from_millis(((today + 1) * 86_400_000 - now_ms).max(0) as u64);
        debug_assert!(tomorrow <= Duration::from_secs(86_400), "the next day begins in {tomorrow:?}");
        for (what, limit, used, more, retry) in [
            ("studies", quota.studies, all.studies, more.studies, None),
            ("trials", quota.trials, all.trials, more.trials, None),
            ("trials a day", quota.trials_per_day, of_today.trials, more.trials, Some(tomorrow)),
            ("bytes a day", quota.bytes_per_day, of_today.bytes, more.bytes, Some(tomorrow)),
        ] {
            if let Some(limit) = limit
                && more > 0
                && used.saturating_add(more) > limit
            {
                return Err(self.over(what, limit, retry));
            }
        }
        if reserve {
            used.reserved.add(more)
        } else {
            used.add(more)
        }
        Ok(())
    }

    /// Ends a reservation. If its request succeeded, it counts as used.
    fn settle(&self, what: Usage, came_about: bool) {
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        debug_assert_eq!(what.bytes, 0, "bytes are not reserved");
        let reserved = &mut used.reserved;
        debug_assert!(reserved.studies >= what.studies, "{reserved:?}, {what:?}");
        debug_assert!(reserved.trials >= what.trials, "{reserved:?}, {what:?}");
        reserved.studies = reserved.studies.saturating_sub(what.studies);
        reserved.trials = reserved.trials.saturating_sub(what.trials);
        if came_about {
            used.turn(day(self.clock.now_ms()));
            used.add(what);
        }
    }

    fn over(&self, what: &'static str, limit: u64, retry: Option<Duration>) -> Error {
        let refused = self.refused.fetch_add(1, Ordering::Relaxed);
        if refused.is_multiple_of(1000) {
            tracing::info!(token = self.id, what, limit, refused, "a quota is reached");
        }
        Error::Quota { what, limit, retry }
    }
}

impl std::fmt::Debug for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Holder").field("id", &self.id).finish_non_exhaustive()
    }
}

impl Caller {
    /// The token's public part; empty where none is required.
    pub fn id(&self) -> &str {
        match self {
            Self::Anyone => "",
            Self::Holder(holder) => &holder.id,
        }
    }

    /// Whether the token permits this at the moment.
    pub fn may(&self, scope: Scope) -> Result<()> {
        let Self::Holder(holder) = self else {
            return Ok(());
        };
        if holder.terms()?.scope >= scope {
            Ok(())
        } else {
            Err(Error::Denied("the token's scope does not include this"))
        }
    }

    /// Whether some studies are hidden from the caller.
    pub fn is_limited(&self) -> bool {
        matches!(self, Self::Holder(holder) if holder.stored().is_none_or(|terms| !terms.studies.0.is_empty()))
    }

    /// Whether the caller may know of a study.
    pub fn sees(&self, study: &str) -> bool {
        match self {
            Self::Anyone => true,
            Self::Holder(holder) => holder.terms().is_ok_and(|terms| terms.studies.contains(study)),
        }
    }

    /// Checks that the caller may know of a study. The answer does not show whether the study exists.
    pub fn reach(&self, study: &str) -> Result<()> {
        if self.sees(study) { Ok(()) } else { Err(Error::Denied("the token is not good for this study")) }
    }

    /// Counts a request or a frame of `bytes` bytes.
    ///
    /// # Errors
    /// [`Error::Quota`], or [`Error::Unauthenticated`] when the token has ended meanwhile.
    pub fn spend_request(&self, bytes: usize) -> Result<()> {
        let Self::Holder(holder) = self else {
            return Ok(());
        };
        if let Some(per_s) = holder.terms()?.quota.requests_per_s {
            let taken = holder.rate.take(per_s, Instant::now());
            taken.map_err(|wait| holder.over("requests a second", per_s.into(), Some(wait)))?;
        }
        holder.spend(Usage { bytes: bytes as u64, ..Usage::default() }, false)
    }

    /// Counts a trial that is to be handed out.
    pub fn spend_trial(&self) -> Result<Spent<'_>> {
        self.spend(Usage { trials: 1, ..Usage::default() })
    }

    /// Counts a study that is to be created.
    pub fn spend_study(&self) -> Result<Spent<'_>> {
        self.spend(Usage { studies: 1, ..Usage::default() })
    }

    fn spend(&self, what: Usage) -> Result<Spent<'_>> {
        if let Self::Holder(holder) = self {
            holder.spend(what, true)?;
        }
        Ok(Spent { caller: self, what, came_about: false })
    }
}

/// A reserved part of a quota, given back unless it is kept.
#[derive(Debug)]
#[must_use = "dropped, it is given back"]
pub struct Spent<'a> {
    caller: &'a Caller,
    what: Usage,
    came_about: bool,
}

impl Spent<'_> {
    /// The request succeeded: the part counts as used.
    pub fn keep(mut self) {
        self.came_about = true;
    }
}

impl Drop for Spent<'_> {
    fn drop(&mut self) {
        if let Caller::Holder(holder) = self.caller {
            holder.settle(self.what, self.came_about);
        }
    }
}

/// When the stored tokens were last read. A copy that is too old admits no caller, because a token may have
/// been revoked meanwhile.
#[derive(Debug)]
pub(super) struct LastRead(Mutex<Instant>);

impl LastRead {
    pub(super) fn now() -> Self {
        Self(Mutex::new(Instant::now()))
    }

    pub(super) fn again(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Whether the copy is still recent enough.
    pub(super) fn check(&self) -> Result<()> {
        let age = self.0.lock().unwrap_or_else(PoisonError::into_inner).elapsed();
        if age <= limits::TOKENS_STALE {
            return Ok(());
        }
        let problem = format!("the tokens could not be read for {} s", age.as_secs());
        Err(Error::Tokens(TokenError::Store(StoreError::Unavailable(problem))))
    }
}
