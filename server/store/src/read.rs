//! The questions that only read, and the creation and naming of studies, once for both databases.
//!
//! They differ only in the type of a connection, but sqlx's bounds for a generic connection are longer than
//! the questions. So [`reads!`] writes them out for each database, in a module with the database's statements
//! as `sql`, and its errors of reads and writes as `failed` and `refused`.

/// Asks a database with bound values, by one of sqlx's ways to ask and to fetch, and translates errors with
/// `failed` of the module.
macro_rules! ask {
    ($query:ident.$fetch:ident($connection:expr, $sql:expr $(, $value:expr)*)) => {
        sqlx::$query($sql)$(.bind($value))*.$fetch(&mut *$connection).await.map_err(failed)
    };
}

/// The functions of this module, for one type of connection.
macro_rules! reads {
    ($connection:ty) => {
        use tokio_stream::StreamExt as _;
        use treewright_core::ids::StudyUid;
        use treewright_core::space::EarlierSpaces;
        use treewright_core::study::StudySpec;
        use treewright_core::trial::RawTrial;
        use treewright_core::tuner::{Checkpoint, StateRecord};

        use crate::assembly::{self, StudyRow, StudyRows, page, study_not_found};
        use crate::error::{Result, StoreError};
        use crate::fence::Fence;
        use crate::limits;
        use crate::read::ask;
        use crate::rows::{self, StateRow, TrialRow, one_at_most, signed, unsigned};
        use crate::store::{ClosedTrial, Created, Loaded, StudyRecord, TrialPage, TrialQuery};

        /// Creates a study, or finds an equal one. If two replicas try at once, one of them creates it, and
        /// both compare the stored study.
        pub(super) async fn create(
            connection: &mut $connection,
            id: &str,
            spec: &StudySpec,
            now_ms: i64,
        ) -> Result<Created> {
            match study(&mut *connection, id).await {
                Ok(stored) => return stored.found(spec),
                Err(StoreError::StudyNotFound { .. }) => {}
                Err(error) => return Err(error),
            }
            let count: i64 = ask!(query_scalar.fetch_one(connection, sql::STUDY_COUNT))?;
            if count >= i64::from(limits::STUDIES) {
                return Err(StoreError::TooManyStudies(limits::STUDIES));
            }
            let (specification, policy) = rows::specification(spec, &EarlierSpaces::default())?;
            let inserting = sqlx::query(sql::STUDY_INSERT).bind(id).bind(specification).bind(policy);
            let inserted = inserting.bind(now_ms).execute(&mut *connection).await.map_err(refused)?;
            one_at_most(inserted.rows_affected());
            let is_new = inserted.rows_affected() == 1;
            Ok(Created { is_new, ..study(connection, id).await?.found(spec)? })
        }

        /// The key of a study that has the identity, where one is given. In PostgreSQL no replica stores its
        /// rows until the end of the transaction.
        pub(super) async fn lock(
            connection: &mut $connection,
            study: &str,
            uid: Option<StudyUid>,
        ) -> Result<i64> {
            let uid = uid.map(|uid| uid.to_string());
            ask!(query_scalar.fetch_optional(connection, sql::STUDY_LOCK, study, uid))?
                .ok_or_else(|| study_not_found(study))
        }

        /// Notes the last trial number of a study under the name that it is about to lose.
        pub(super) async fn leave_name(connection: &mut $connection, key: i64) -> Result<()> {
            let noted = sqlx::query(sql::NAME_LEFT).bind(key).execute(&mut *connection).await;
            one_at_most(noted.map_err(refused)?.rows_affected());
            fold_names(connection, limits::FORMER_NAMES).await.map_err(refused)
        }

        async fn fold_names(connection: &mut $connection, listed: u32) -> Result<(), sqlx::Error> {
            let folding = sqlx::query(sql::NAMES_FOLDED).bind(i64::from(listed));
            one_at_most(folding.execute(&mut *connection).await?.rows_affected());
            sqlx::query(sql::FOLDED_NAMES_DELETE).execute(connection).await.map(|_| ())
        }

        pub(super) async fn study_key(connection: &mut $connection, study: &str) -> Result<i64> {
            ask!(query_scalar.fetch_optional(connection, sql::STUDY_KEY, study))?
                .ok_or_else(|| study_not_found(study))
        }

        pub(super) async fn study_of_uid(
            connection: &mut $connection,
            uid: StudyUid,
        ) -> Result<Option<String>> {
            ask!(query_scalar.fetch_optional(connection, sql::STUDY_OF_UID, uid.to_string()))
        }

        pub(super) async fn study(connection: &mut $connection, study: &str) -> Result<StudyRecord> {
            let row: Option<StudyRow> = ask!(query_as.fetch_optional(connection, sql::STUDY_BY_NAME, study))?;
            row.ok_or_else(|| study_not_found(study))?.into_record()
        }

        pub(super) async fn studies(
            connection: &mut $connection,
            after: Option<&str>,
            size: u32,
        ) -> Result<Vec<StudyRecord>> {
            let (after, most) = (after.unwrap_or_default(), i64::from(size));
            let rows: Vec<StudyRow> = ask!(query_as.fetch_all(connection, sql::STUDY_PAGE, after, most))?;
            assert!(rows.len() <= size as usize, "{} studies on a page of {size}", rows.len());
            debug_assert!(StudyRow::follow(&rows, after), "studies come by rising name");
            rows.into_iter().map(StudyRow::into_record).collect()
        }

        /// Reads all of a study but its closed trials, as of one moment.
        pub(super) async fn load(connection: &mut $connection, fence: Fence) -> Result<Loaded> {
            use sqlx::Connection as _;

            let key = fence.key();
            // All reads see one moment: another daemon may take the study and write while this one reads.
            let mut moment = connection.begin_with(sql::BEGIN_READING).await.map_err(failed)?;
            let connection = &mut *moment;
            let study: Option<StudyRow> = ask!(query_as.fetch_optional(connection, sql::STUDY_BY_KEY, key))?;
            let study = study.ok_or_else(|| study_not_found(fence.study()))?;
            let visits = ask!(query_as.fetch_all(connection, sql::VISITS_OF_STUDY, key))?;
            let open_trials = ask!(query_as.fetch_all(connection, sql::OPEN_TRIALS, key))?;
            let states = states(connection, key).await?;
            let checkpoint = checkpoint(connection, key).await?;
            moment.commit().await.map_err(failed)?;
            StudyRows { study, states, visits, open_trials, checkpoint }.into_loaded(fence)
        }

        /// Reads states row by row, because a study may have a million of them.
        async fn states(connection: &mut $connection, key: i64) -> Result<Vec<StateRecord>> {
            let mut rows = sqlx::query_as::<_, StateRow>(sql::STATES_OF_STUDY).bind(key).fetch(connection);
            let mut states = Vec::new();
            while let Some(row) = rows.next().await {
                states.push(row.map_err(failed)?.into_state()?);
            }
            Ok(states)
        }

        async fn checkpoint(connection: &mut $connection, key: i64) -> Result<Option<Checkpoint>> {
            let latest: Option<i64> = ask!(query_scalar.fetch_optional(connection, sql::CHECKPOINT, key))?;
            let Some(completion) = latest else { return Ok(None) };
            let parts: Vec<Vec<u8>> =
                ask!(query_scalar.fetch_all(connection, sql::CHECKPOINT_PARTS, key, completion))?;
            debug_assert!(!parts.is_empty(), "the checkpoint {completion} was found by its parts");
            Ok(Some(Checkpoint { completion: unsigned(completion)?, bytes: parts.concat() }))
        }

        /// Reads completed trials behind a place in their order.
        pub(super) async fn completed(
            connection: &mut $connection,
            fence: &Fence,
            after: u64,
            size: u32,
        ) -> Result<Vec<RawTrial>> {
            let (study, begin, most) = (fence.key(), signed(after)?, i64::from(size));
            let rows: Vec<TrialRow> =
                ask!(query_as.fetch_all(connection, sql::COMPLETED_TRIALS, study, begin, most))?;
            assert!(rows.len() <= size as usize, "{} trials in a stretch of {size}", rows.len());
            let trials: Vec<_> = rows.into_iter().map(TrialRow::into_trial).collect::<Result<_, _>>()?;
            debug_assert!(
                assembly::rise_behind(after, trials.iter().map(|trial| trial.completion.unwrap_or(0))),
                "completed trials come in the order of completion, behind {after}"
            );
            Ok(trials)
        }

        /// Reads the closed trials of a stretch of numbers.
        pub(super) async fn closed(
            connection: &mut $connection,
            fence: &Fence,
            after: u64,
            up_to: u64,
            size: u32,
        ) -> Result<Vec<ClosedTrial>> {
            let (study, begin, end, most) = (fence.key(), signed(after)?, signed(up_to)?, i64::from(size));
            let rows: Vec<(i64, Option<i64>)> =
                ask!(query_as.fetch_all(connection, sql::CLOSED_TRIALS, study, begin, end, most))?;
            assert!(rows.len() <= size as usize, "{} trials in a stretch of {size}", rows.len());
            let closed = assembly::closed(rows)?;
            debug_assert!(
                assembly::rise_behind(after, closed.iter().map(|trial| trial.number))
                    && closed.last().is_none_or(|last| last.number <= up_to),
                "closed trials come by rising number, behind {after} and up to {up_to}"
            );
            Ok(closed)
        }

        pub(super) async fn trial(
            connection: &mut $connection,
            study: &str,
            number: u64,
        ) -> Result<RawTrial> {
            let key = study_key(&mut *connection, study).await?;
            let not_found = || StoreError::TrialNotFound { study: study.to_owned(), number };
            // No trial has a number that the column cannot hold.
            let number = signed(number).map_err(|_| not_found())?;
            let row: Option<TrialRow> =
                ask!(query_as.fetch_optional(connection, sql::TRIAL_BY_NUMBER, key, number))?;
            row.ok_or_else(not_found)?.into_trial()
        }

        pub(super) async fn trials(
            connection: &mut $connection,
            study: &str,
            query: &TrialQuery,
        ) -> Result<TrialPage> {
            let key = study_key(&mut *connection, study).await?;
            let mut sql = sqlx::QueryBuilder::<<$connection as sqlx::Connection>::Database>::new("");
            crate::question::trial_page(&mut sql, key, query)?;
            let rows: Vec<TrialRow> =
                sql.build_query_as().fetch_all(&mut *connection).await.map_err(failed)?;
            page(rows, query)
        }
    };
}

pub(crate) use {ask, reads};
