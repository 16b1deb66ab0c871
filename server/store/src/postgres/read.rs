//! The questions that only read, and the creation and naming of studies.

use sqlx::postgres::PgConnection;

use super::{failed, failed as refused, statements as sql};

crate::read::reads!(PgConnection);
