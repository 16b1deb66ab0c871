//! `treewrightd token`: makes, lists and revokes tokens in the database itself.
//!
//! There is no RPC for it, on purpose. A user who may write the database can do everything anyway, so this
//! needs no further credential. The first token is made like any other, and no stolen token can make more of
//! them.

use std::sync::Arc;
use std::time::Duration;

use treewright_core::words::Word as _;
#[cfg(feature = "postgres")]
use treewright_store::PostgresTokens;
use treewright_store::tokens::{TokenError, TokenRecord, day};
use treewright_store::{OpenError, SqliteTokens, TokenStore};

use crate::access::token::Token;
use crate::clock::{Clock as _, SystemClock};
use crate::config::{CreateConfig, Database, DatabaseConfig, TokenCommand};

/// Why tokens could not be administered.
#[derive(Debug, thiserror::Error)]
pub enum TokenCommandError {
    /// The database cannot be opened.
    #[error("cannot open the database: {0}")]
    Database(#[from] OpenError),
    /// The database refuses.
    #[error(transparent)]
    Token(#[from] TokenError),
    /// The system has no randomness.
    #[error("the system gives no random numbers: {0}")]
    Randomness(#[from] getrandom::Error),
    /// The list cannot be written.
    #[error("the list cannot be put into JSON: {0}")]
    Json(#[from] serde_json::Error),
}

impl TokenCommandError {
    /// The exit code, as for `serve`.
    pub fn exit_code(&self) -> u8 {
        if matches!(self, Self::Database(_)) { 4 } else { 1 }
    }
}

/// The output of a command: for standard output, and for the user.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct CommandOutput {
    /// The result.
    pub out: String,
    /// A note about the result.
    pub note: String,
}

/// Opens the tokens of a database of either kind, also while daemons serve it.
pub async fn open(config: &DatabaseConfig) -> Result<Arc<dyn TokenStore>, OpenError> {
    match config.read().map_err(OpenError::BadAddress)? {
        Database::File(path) => Ok(Arc::new(SqliteTokens::open(&path).await?)),
        #[cfg(feature = "postgres")]
        Database::Postgres(server) => Ok(Arc::new(PostgresTokens::open(&server, config.wait()).await?)),
    }
}

/// Carries the command out.
///
/// # Errors
/// [`TokenCommandError`]; nothing was changed.
pub async fn run(command: &TokenCommand) -> Result<CommandOutput, TokenCommandError> {
    let now_ms = SystemClock::default().now_ms();
    let database = match command {
        TokenCommand::Create(create) => &create.database,
        TokenCommand::List { database, .. } | TokenCommand::Revoke { database, .. } => database,
    };
    let tokens = open(database).await?;
    let tokens = &*tokens;
    let said = match command {
        TokenCommand::Create(config) => create(tokens, config, now_ms).await,
        TokenCommand::List { json, .. } => list(tokens, *json, now_ms).await,
        TokenCommand::Revoke { id, forget, .. } => revoke(tokens, id, *forget, now_ms).await,
    };
    tokens.close().await;
    said
}

async fn create(
    tokens: &dyn TokenStore,
    config: &CreateConfig,
    now_ms: i64,
) -> Result<CommandOutput, TokenCommandError> {
    let token = Token::make()?;
    let ms = |time: Duration| i64::try_from(time.as_millis()).unwrap_or(i64::MAX);
    let record = TokenRecord {
        id: token.id().to_owned(),
        name: config.name.clone(),
        hash: token.hash(),
        scope: config.scope,
        studies: config.reach(),
        quota: config.quota(),
        create_ms: now_ms,
        expire_ms: config.expires.map(|time| now_ms.saturating_add(ms(time))),
        revoke_ms: None,
    };
    assert!(record.expire_ms.is_none_or(|expire_ms| expire_ms >= now_ms), "it would end before it begins");
    tokens.create(&record).await?;
    let note = format!(
        "treewrightd: token {} for {:?}: {}, {}, {}. Keep it: it is not shown again.",
        record.id,
        record.name,
        scope(&record),
        reach(&record),
        ending(&record, now_ms),
    );
    Ok(CommandOutput { out: token.text(), note })
}

async fn list(tokens: &dyn TokenStore, json: bool, now_ms: i64) -> Result<CommandOutput, TokenCommandError> {
    let records = tokens.list().await?;
    let mut rows = Vec::new();
    for record in &records {
        rows.push((record, tokens.usage(&record.id, day(now_ms)).await?));
    }
    if json {
        let all: Vec<_> = rows
            .iter()
            .map(|(record, (used, today))| {
                serde_json::json!({
                    "id": record.id,
                    "name": record.name,
                    "scope": scope(record),
                    "studies": record.studies,
                    "quota": record.quota,
                    "live": record.is_live(now_ms),
                    "create_ms": record.create_ms,
                    "expire_ms": record.expire_ms,
                    "revoke_ms": record.revoke_ms,
                    "used": { "studies": used.studies, "trials": used.trials, "bytes": used.bytes },
                    "used_today": { "trials": today.trials, "bytes": today.bytes },
                })
            })
            .collect();
        return Ok(CommandOutput { out: serde_json::to_string_pretty(&all)?, note: String::new() });
    }
    if records.is_empty() {
        return Ok(CommandOutput {
            note: "treewrightd: there is no token yet".to_owned(),
            ..CommandOutput::default()
        });
    }
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::NOTHING);
    table.set_header(["ID", "NAME", "SCOPE", "STUDIES", "STATE", "TRIALS", "TODAY"]);
    for (record, (used, today)) in rows {
        table.add_row([
            record.id.clone(),
            record.name.clone(),
            scope(record),
            reach(record),
            ending(record, now_ms),
            used.trials.to_string(),
            today.trials.to_string(),
        ]);
    }
    Ok(CommandOutput { out: table.to_string(), note: String::new() })
}

async fn revoke(
    tokens: &dyn TokenStore,
    id: &str,
    forget: bool,
    now_ms: i64,
) -> Result<CommandOutput, TokenCommandError> {
    // For a whole token, given by mistake, its id is used, and the rest must not be repeated.
    let parsed = Token::parse(id);
    let id = parsed.as_ref().map_or(id, Token::id);
    let done = if forget {
        tokens.forget(id).await?;
        "revoked and forgotten"
    } else {
        tokens.revoke(id, now_ms).await?;
        "revoked"
    };
    Ok(CommandOutput { out: String::new(), note: format!("treewrightd: token {id} is {done}") })
}

fn scope(record: &TokenRecord) -> String {
    record.scope.word().to_lowercase()
}

fn reach(record: &TokenRecord) -> String {
    if record.studies.0.is_empty() { "every study".to_owned() } else { record.studies.0.join(" ") }
}

fn ending(record: &TokenRecord, now_ms: i64) -> String {
    match record.expire_ms {
        _ if record.revoke_ms.is_some() => "revoked".to_owned(),
        Some(expire_ms) if expire_ms <= now_ms => "expired".to_owned(),
        Some(expire_ms) => {
            let left = Duration::from_secs(expire_ms.saturating_sub(now_ms).max(0) as u64 / 1000);
            format!("ends in {}", humantime::format_duration(left))
        }
        None => "never ends".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use treewright_store::MemoryTokens;
    use treewright_store::tokens::Quota;

    use super::*;
    use crate::config::{Cli, Command};

    #[tokio::test]
    async fn a_token_has_the_end_and_the_quotas_that_were_asked_for() {
        let line = "treewrightd token create --database x --name hall --scope read --expires 90s \
                    --requests-per-s 1 --max-studies 2 --max-trials 3 --trials-per-day 4 --bytes-per-day 5";
        let Command::Token(TokenCommand::Create(config)) = Cli::read(line.split(' ')).expect("good").command
        else {
            panic!("it says token create")
        };
        let tokens = MemoryTokens::new();
        create(&tokens, &config, 1_000).await.expect("created");
        let stored = tokens.list().await.expect("listed").remove(0);
        assert_eq!((stored.create_ms, stored.expire_ms), (1_000, Some(91_000)));
        let quota = Quota {
            requests_per_s: Some(1),
            studies: Some(2),
            trials: Some(3),
            trials_per_day: Some(4),
            bytes_per_day: Some(5),
        };
        assert_eq!(stored.quota, quota);
        assert_eq!(ending(&stored, 1_000), "ends in 1m 30s");
        assert_eq!(ending(&stored, 91_000), "expired");
    }
}
