//! Access control: reads the token of a request, and keeps a copy of the stored ones in memory.
//!
//! [`token`] is the form of a token, [`rules`] the scope that each RPC needs, [`caller`] an admitted caller
//! with the rest of the quotas, `rate` the limit of requests a second.
//!
//! The copy follows the database, whose revision is read ten times a second. So a token that was made,
//! changed or revoked through any replica counts at once, also on open streams. While the database cannot be
//! read the copy stays, for [`TOKENS_STALE`](crate::limits::TOKENS_STALE). Then no caller is admitted,
//! because a token may have been revoked meanwhile.
//!
//! The usage of a token is counted here and added up in the database, which returns the sum of all replicas.
//! Together they exceed a quota at most by the usage between two such exchanges.

pub mod caller;
mod rate;
pub mod rules;
pub mod token;

use std::collections::{BTreeMap, HashMap};
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use tokio::sync::Notify;
use tokio::time::{MissedTickBehavior, interval, timeout};
use treewright_store::tokens::{TokenError, TokenRecord, Usage, day};
use treewright_store::{StoreError, TokenStore};

use crate::clock::Clock;
use crate::error::{Error, Result};
use crate::limits;
use crate::trouble::Trouble;
use caller::{Caller, Holder, LastRead};
use rules::Need;
use token::Token;

/// The tokens that admit callers.
pub struct Access {
    store: Arc<dyn TokenStore>,
    clock: Arc<dyn Clock>,
    known: RwLock<KnownTokens>,
    seen: Arc<LastRead>,
    /// With the storing of usage.
    storing: Mutex<Trouble>,
    /// With the reading of usage, which may fail where storing does not.
    reading: Mutex<Trouble>,
}

#[derive(Default)]
struct KnownTokens {
    revision: Option<i64>,
    records: HashMap<String, TokenRecord>,
    /// The tokens that were used since the start, so that memory does not grow with the stored ones.
    holders: HashMap<String, Arc<Holder>>,
}

impl Access {
    /// Reads the stored tokens.
    pub async fn open(store: Arc<dyn TokenStore>, clock: Arc<dyn Clock>) -> Result<Self, TokenError> {
        let (known, seen) = (RwLock::default(), Arc::new(LastRead::now()));
        let (storing, reading) = <_>::default();
        let access = Self { store, clock, known, seen, storing, reading };
        access.refresh().await?;
        Ok(access)
    }

    /// The number of tokens that are valid at the moment.
    pub fn live(&self) -> usize {
        let now_ms = self.clock.now_ms();
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        known.records.values().filter(|record| record.is_live(now_ms)).count()
    }

    /// Reads the stored tokens if they have changed.
    ///
    /// # Errors
    /// When they cannot be read; the copy stays as it was.
    pub async fn refresh(&self) -> Result<(), TokenError> {
        let revision = self.store.revision().await?;
        if self.known.read().unwrap_or_else(PoisonError::into_inner).revision == Some(revision) {
            self.seen.again();
            return Ok(());
        }
        let records = self.store.list().await?;
        let stored = records.len();
        self.seen.again();
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        known.records = records.into_iter().map(|record| (record.id.clone(), record)).collect();
        debug_assert_eq!(known.records.len(), stored, "two tokens have one id");
        known.revision = Some(revision);
        for (id, holder) in &known.holders {
            // A token of that id with another secret is another token.
            let same = |record: &&TokenRecord| holder.stored().is_some_and(|old| old.hash == record.hash);
            holder.replace(known.records.get(id).filter(same).cloned());
        }
        let KnownTokens { records, holders, .. } = &mut *known;
        holders.retain(|id, holder| records.contains_key(id) && holder.stored().is_some());
        assert!(holders.len() <= records.len(), "{} holders of {} tokens", holders.len(), records.len());
        Ok(())
    }

    /// Follows the database, and stores usage beside that, until `ends`. Dropped before, it may lose the
    /// usage that it is storing, or leave it to be stored again.
    pub async fn follow(&self, ends: impl Future<Output = ()>) {
        let over = Notify::new();
        let looking = async {
            tokio::select! {
                () = ends => {}
                () = self.look() => {}
            }
            over.notify_one();
        };
        let saving = async {
            let mut saves = interval(limits::USAGE_PERIOD);
            saves.set_missed_tick_behavior(MissedTickBehavior::Delay);
            let mut ends = pin!(over.notified());
            loop {
                // The end first: a store that gives no answer would else delay it, save after save.
                tokio::select! {
                    biased;
                    () = &mut ends => return,
                    _ = saves.tick() => {}
                }
                let limited = self.store_usage().await;
                tokio::select! {
                    biased;
                    () = &mut ends => return,
                    () = self.read_usage(limited) => {}
                }
            }
        };
        tokio::join!(looking, saving);
    }

    /// Reads the stored tokens for ever, as often as they may have changed.
    async fn look(&self) {
        let mut looks = interval(limits::TOKENS_PERIOD);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut trouble = Trouble::default();
        loop {
            looks.tick().await;
            match in_time(self.refresh()).await {
                Ok(()) if trouble.is_over() => tracing::info!("the tokens can be read again"),
                Err(error) if trouble.is_worth_a_line() => tracing::warn!(
                    %error,
                    for_s = limits::TOKENS_STALE.as_secs(),
                    "the tokens cannot be read; those known stay good for a while"
                ),
                _ => {}
            }
        }
    }

    /// Stores the usage here, and reads the usage everywhere.
    pub async fn save(&self) {
        let limited = self.store_usage().await;
        self.read_usage(limited).await;
    }

    /// Stores the usage here, and returns the holders with quotas, each with the day of its usage.
    async fn store_usage(&self) -> Vec<(Arc<Holder>, i64)> {
        let holders: Vec<_> = {
            let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
            known.holders.values().cloned().collect()
        };
        let mut by_day: BTreeMap<i64, Vec<(Arc<Holder>, Usage)>> = BTreeMap::new();
        for holder in holders {
            if let Some((day, used)) = holder.take_unsaved() {
                by_day.entry(day).or_default().push((holder, used));
            }
        }
        let mut limited = Vec::new();
        for (day, used) in by_day {
            let rows: Vec<_> = used.iter().map(|(holder, used)| (holder.id.clone(), *used)).collect();
            let stored = in_time(self.store.add_usage(day, &rows)).await;
            if stored.is_err() {
                // What was stored although nothing said so counts twice: a quota holds in doubt.
                used.iter().for_each(|(holder, used)| holder.put_back(*used));
            }
            if note(&self.storing, stored, "what tokens used cannot be stored; trying again").is_some() {
                limited.extend(
                    used.into_iter()
                        .map(|(holder, _)| (holder, day))
                        .filter(|(holder, _)| holder.is_limited()),
                );
            }
        }
        limited
    }

    /// Reads the usage of these holders everywhere, up to the first failure.
    async fn read_usage(&self, holders: Vec<(Arc<Holder>, i64)>) {
        for (holder, day) in holders {
            let stored = in_time(self.store.usage(&holder.id, day)).await;
            let Some(stored) = note(&self.reading, stored, "what tokens used elsewhere cannot be read")
            else {
                return;
            };
            holder.learn(day, stored);
        }
    }

    /// Stores usage and closes the store.
    pub async fn close(&self) {
        self.store_usage().await;
        self.store.close().await;
    }

    /// Admits a request with the needed credential.
    ///
    /// # Errors
    /// [`Error::Unauthenticated`] for no token and for one that is wrong or has ended, [`Error::Denied`] for
    /// one of too narrow a scope.
    pub async fn authorize(&self, need: Need, authorization: Authorization<'_>) -> Result<Caller> {
        let Need::Scope(scope) = need else {
            return Ok(Caller::Anyone);
        };
        let text = match authorization {
            Authorization::Missing => {
                return Err(Error::Unauthenticated("no token; send it as `authorization: Bearer TOKEN`"));
            }
            Authorization::Malformed => {
                return Err(Error::Unauthenticated("the authorization is not `Bearer TOKEN`"));
            }
            Authorization::Bearer(text) => text,
        };
        self.seen.check()?;
        const WRONG: Error = Error::Unauthenticated("the token is not known here");
        let token = Token::parse(text).ok_or(WRONG)?;
        let (record, holder) = {
            let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
            (known.records.get(token.id()).cloned(), known.holders.get(token.id()).cloned())
        };
        // An unknown id takes as long as a known one.
        let hash = record.as_ref().map_or([0; 32], |record| record.hash);
        let record = record.filter(|_| token.fits(&hash)).ok_or(WRONG)?;
        assert_eq!(record.id, token.id());
        debug_assert!(token.fits(&record.hash), "a token with another secret is let in");
        let holder = match holder {
            Some(holder) => holder,
            None => self.hold(record).await?,
        };
        assert_eq!(holder.id, token.id());
        let caller = Caller::Holder(holder);
        caller.may(scope)?;
        Ok(caller)
    }

    /// The place in memory of a token that is used for the first time.
    async fn hold(&self, record: TokenRecord) -> Result<Arc<Holder>> {
        let used = self.store.usage(&record.id, day(self.clock.now_ms())).await.map_err(Error::Tokens)?;
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        // The terms may have changed while the use was read.
        let current = known.records.get(&record.id).filter(|current| current.hash == record.hash).cloned();
        let current = current.ok_or(Error::Unauthenticated("the token was revoked"))?;
        let made = || Arc::new(Holder::new(current, used, Arc::clone(&self.seen), Arc::clone(&self.clock)));
        Ok(Arc::clone(known.holders.entry(record.id).or_insert_with(made)))
    }
}

/// Logs trouble with the usage, rarely, and its end.
fn note<T>(trouble: &Mutex<Trouble>, result: Result<T, TokenError>, problem: &'static str) -> Option<T> {
    let mut trouble = trouble.lock().unwrap_or_else(PoisonError::into_inner);
    match &result {
        Ok(_) if trouble.is_over() => tracing::info!("no longer: {problem}"),
        Err(error) if trouble.is_worth_a_line() => tracing::warn!(%error, "{problem}"),
        _ => {}
    }
    result.ok()
}

/// Waits for the database no longer than it may take about tokens.
async fn in_time<T>(asked: impl Future<Output = Result<T, TokenError>>) -> Result<T, TokenError> {
    timeout(limits::TOKENS_WAIT, asked).await.unwrap_or_else(|_| {
        let problem = format!("it did not answer within {} s", limits::TOKENS_WAIT.as_secs());
        Err(TokenError::Store(StoreError::Unavailable(problem)))
    })
}

/// The `authorization` of a request.
#[derive(Clone, Copy)]
pub enum Authorization<'a> {
    /// The header is missing.
    Missing,
    /// It is not a bearer token, or there are several.
    Malformed,
    /// The text behind `Bearer`.
    Bearer(&'a str),
}

impl<'a> Authorization<'a> {
    /// Reads the authorization from the headers.
    pub fn of(headers: &'a http::HeaderMap) -> Self {
        let mut values = headers.get_all(http::header::AUTHORIZATION).iter();
        let (Some(value), None) = (values.next(), values.next()) else {
            let none = !headers.contains_key(http::header::AUTHORIZATION);
            return if none { Self::Missing } else { Self::Malformed };
        };
        match value.to_str().ok().and_then(|text| text.split_once(' ')) {
            Some((scheme, token)) if scheme.eq_ignore_ascii_case("bearer") => Self::Bearer(token.trim()),
            _ => Self::Malformed,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    use async_trait::async_trait;
    use tokio::time::sleep;
    use treewright_store::MemoryTokens;
    use treewright_store::tokens::{Quota, Scope, Studies};

    use super::*;
    use crate::clock::ManualClock;

    const TUNE: Need = Need::Scope(Scope::Tune);

    /// A token in a store, and the access control that reads it.
    async fn access(quota: Quota) -> (Arc<MemoryTokens>, Access, String) {
        let (tokens, token) = (Arc::new(MemoryTokens::new()), Token::make().unwrap());
        let record = TokenRecord {
            id: token.id().to_owned(),
            name: "a test".to_owned(),
            hash: token.hash(),
            scope: Scope::Tune,
            studies: Studies::default(),
            quota,
            create_ms: 0,
            expire_ms: None,
            revoke_ms: None,
        };
        tokens.create(&record).await.unwrap();
        let access = Access::open(Arc::clone(&tokens) as _, Arc::new(ManualClock::at(1))).await.unwrap();
        (tokens, access, token.text())
    }

    #[tokio::test(start_paused = true)]
    async fn a_daemon_that_is_cut_off_from_the_tokens_lets_nobody_in_after_a_while() {
        let (tokens, access, text) = access(Quota::default()).await;
        let caller = access.authorize(TUNE, Authorization::Bearer(&text)).await.unwrap();
        tokens.close().await;
        tokio::time::advance(limits::TOKENS_STALE).await;
        access.refresh().await.unwrap_err();
        access.authorize(TUNE, Authorization::Bearer(&text)).await.expect("still believed");
        tokio::time::advance(limits::TOKENS_PERIOD).await;
        let refused = access.authorize(TUNE, Authorization::Bearer(&text)).await.unwrap_err();
        assert!(matches!(refused, Error::Tokens(_)), "{refused}");
        // Also on streams that are open.
        assert!(matches!(caller.may(Scope::Tune), Err(Error::Tokens(_))));
    }

    #[tokio::test]
    async fn what_is_reserved_counts_and_is_stored_only_once_it_came_about() {
        let (tokens, access, text) = access(Quota { trials: Some(2), ..Quota::default() }).await;
        let caller = access.authorize(TUNE, Authorization::Bearer(&text)).await.unwrap();
        let (one, other) = (caller.spend_trial().unwrap(), caller.spend_trial().unwrap());
        assert!(matches!(caller.spend_trial(), Err(Error::Quota { limit: 2, .. })));
        access.save().await;
        assert_eq!(tokens.usage(caller.id(), 0).await.unwrap().0.trials, 0);
        one.keep();
        drop(other);
        access.save().await;
        assert_eq!(tokens.usage(caller.id(), 0).await.unwrap().0.trials, 1);

        // Another replica uses the rest, which shows at the next exchange.
        let elsewhere = Usage { trials: 1, ..Usage::default() };
        tokens.add_usage(0, &[(caller.id().to_owned(), elsewhere)]).await.unwrap();
        caller.spend_request(10).unwrap();
        access.save().await;
        assert!(matches!(caller.spend_trial(), Err(Error::Quota { limit: 2, .. })));
    }

    /// Tokens in a database that takes so long to store usage, and as long to say that it has. It may leave
    /// questions without an answer.
    struct Slow {
        tokens: Arc<MemoryTokens>,
        storing: Duration,
        is_silent: AtomicBool,
    }

    const SLOW: Duration = Duration::from_secs(1);

    impl Slow {
        fn new(tokens: &Arc<MemoryTokens>, storing: Duration) -> Arc<Self> {
            Arc::new(Self { tokens: Arc::clone(tokens), storing, is_silent: AtomicBool::new(false) })
        }

        async fn asked(&self) -> &MemoryTokens {
            if self.is_silent.load(Ordering::Relaxed) {
                std::future::pending::<()>().await;
            }
            &self.tokens
        }
    }

    #[async_trait]
    impl TokenStore for Slow {
        async fn create(&self, token: &TokenRecord) -> Result<(), TokenError> {
            self.tokens.create(token).await
        }
        async fn list(&self) -> Result<Vec<TokenRecord>, TokenError> {
            self.asked().await.list().await
        }
        async fn revoke(&self, id: &str, now_ms: i64) -> Result<(), TokenError> {
            self.tokens.revoke(id, now_ms).await
        }
        async fn forget(&self, id: &str) -> Result<(), TokenError> {
            self.tokens.forget(id).await
        }
        async fn revision(&self) -> Result<i64, TokenError> {
            self.asked().await.revision().await
        }
        async fn usage(&self, id: &str, day: i64) -> Result<(Usage, Usage), TokenError> {
            self.asked().await.usage(id, day).await
        }
        async fn add_usage(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError> {
            sleep(self.storing).await;
            let added = self.tokens.add_usage(day, used).await;
            sleep(self.storing).await;
            added
        }
        async fn close(&self) {}
    }

    #[tokio::test(start_paused = true)]
    async fn what_is_used_until_the_stop_is_stored_once() {
        let (tokens, access, text) = access(Quota::default()).await;
        let access = Access { store: Slow::new(&tokens, SLOW), ..access };
        let caller = access.authorize(TUNE, Authorization::Bearer(&text)).await.unwrap();
        let ends = Notify::new();
        let follow = access.follow(ends.notified());
        let stop = async {
            sleep(limits::USAGE_PERIOD / 2).await;
            caller.spend_trial().unwrap().keep();
            // It is being stored.
            sleep(limits::USAGE_PERIOD / 2 + SLOW / 2).await;
            caller.spend_trial().unwrap().keep();
            ends.notify_one();
        };
        let ((), ()) = tokio::join!(follow, stop);
        access.close().await;
        assert_eq!(tokens.usage(caller.id(), 0).await.unwrap().0.trials, 2);
    }

    #[tokio::test(start_paused = true)]
    async fn usage_that_is_not_taken_delays_neither_a_revocation_nor_the_stop_for_long() {
        let (tokens, access, text) = access(Quota::default()).await;
        let access = Access { store: Slow::new(&tokens, 1000 * limits::TOKENS_WAIT), ..access };
        let caller = access.authorize(TUNE, Authorization::Bearer(&text)).await.unwrap();
        caller.spend_trial().unwrap().keep();
        let ends = Notify::new();
        let follow = access.follow(ends.notified());
        let stop = async {
            sleep(limits::USAGE_PERIOD).await;
            tokens.revoke(caller.id(), 1).await.unwrap();
            sleep(2 * limits::TOKENS_PERIOD).await;
            let refused = caller.may(Scope::Tune);
            ends.notify_one();
            refused
        };
        let (begun, ((), refused)) = (tokio::time::Instant::now(), tokio::join!(follow, stop));
        assert!(matches!(refused, Err(Error::Unauthenticated(_))), "{refused:?}");
        access.close().await;
        assert!(begun.elapsed() <= 3 * limits::TOKENS_WAIT, "{:?}", begun.elapsed());
    }

    #[tokio::test(start_paused = true)]
    async fn a_look_that_gets_no_answer_ends_and_the_next_one_finds_the_tokens() {
        let (tokens, access, text) = access(Quota::default()).await;
        let slow = Slow::new(&tokens, Duration::ZERO);
        let access = Access { store: Arc::clone(&slow) as _, ..access };
        slow.is_silent.store(true, Ordering::Relaxed);
        let ends = Notify::new();
        let follow = access.follow(ends.notified());
        let stop = async {
            sleep(limits::TOKENS_PERIOD / 2).await;
            slow.is_silent.store(false, Ordering::Relaxed);
            sleep(2 * limits::TOKENS_STALE).await;
            ends.notify_one();
        };
        let ((), ()) = tokio::join!(follow, stop);
        access.authorize(TUNE, Authorization::Bearer(&text)).await.expect("the copy is recent");
    }

    #[tokio::test(start_paused = true)]
    async fn usage_that_is_stored_is_no_end_of_the_trouble_with_reading_it() {
        let (tokens, access, text) = access(Quota { trials: Some(9), ..Quota::default() }).await;
        let slow = Slow::new(&tokens, Duration::ZERO);
        let access = Access { store: Arc::clone(&slow) as _, ..access };
        let caller = access.authorize(TUNE, Authorization::Bearer(&text)).await.unwrap();
        // Both are spent before the copy of the tokens is too old.
        let spent = [caller.spend_trial().unwrap(), caller.spend_trial().unwrap()];
        slow.is_silent.store(true, Ordering::Relaxed);
        for trial in spent {
            trial.keep();
            access.save().await;
            sleep(limits::TROUBLE_PERIOD / 2).await;
        }
        let is_due = access.reading.lock().unwrap().is_worth_a_line();
        assert!(is_due, "there was a line at the first failure, and none at the second");
    }
}
