//! The questions that only read.

use sqlx::postgres::PgConnection;

use super::{failed, filter, statements as sql};

crate::read::reads!(PgConnection);
