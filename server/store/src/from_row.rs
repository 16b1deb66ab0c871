//! Structs that are read from rows by the names of their columns.
//!
//! sqlx has a derive macro for this, but its crate compiles both databases a second time: a minute and a half
//! of a first build for five structs.

/// Declares a struct and `sqlx::FromRow` for it: each field is read from the column of its name.
macro_rules! row {
    ($(#[$meta:meta])* $scope:vis struct $row:ident {
        $($(#[$about:meta])* $inner:vis $field:ident: $kind:ty,)+
    }) => {
        $(#[$meta])*
        $scope struct $row {
            $($(#[$about])* $inner $field: $kind,)+
        }

        impl<'r, R: sqlx::Row> sqlx::FromRow<'r, R> for $row
        where
            &'static str: sqlx::ColumnIndex<R>,
            $($kind: sqlx::Decode<'r, R::Database> + sqlx::Type<R::Database>,)+
        {
            fn from_row(row: &'r R) -> sqlx::Result<Self> {
                Ok(Self { $($field: row.try_get(stringify!($field))?,)+ })
            }
        }
    };
}

pub(crate) use row;
