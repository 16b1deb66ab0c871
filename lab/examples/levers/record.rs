//! Rows that were measured before, so that a campaign can be split and goes on after a break.

use std::collections::BTreeSet;

use serde::Serialize;
use serde::de::DeserializeOwned;
use treewright_lab::json_lines;

use crate::{Arguments, Failure};

/// The rows of the files to add and of the record, which is begun if there is none.
pub(crate) fn measured_before<C, R>(
    arguments: &Arguments,
    conditions: &C,
    world: impl Fn(&R) -> &str,
) -> Result<Vec<R>, Failure>
where
    C: DeserializeOwned + PartialEq + Serialize,
    R: DeserializeOwned,
{
    if let Some(record) = &arguments.record {
        json_lines::begin(record, conditions)?;
    }
    let mut all: Vec<R> = Vec::new();
    for file in arguments.add.iter().chain(&arguments.record) {
        let (found, rows) = json_lines::read::<C, R>(file)?;
        if found != *conditions {
            let file = file.display();
            return Err(format!(
                "{file} was measured with other options, ways or code: its first line says which"
            )
            .into());
        }
        for row in rows {
            all.push(row?);
        }
    }
    let mut names = BTreeSet::new();
    let repeated = all.iter().map(world).find(|name| !names.insert(*name)).map(str::to_owned);
    match repeated {
        Some(name) => Err(format!("{name} is there twice: name each file once").into()),
        None => Ok(all),
    }
}

/// Keeps a row, on the disk when this returns.
pub(crate) fn keep(arguments: &Arguments, row: &impl Serialize) -> Result<(), Failure> {
    if let Some(record) = &arguments.record {
        json_lines::add(record, row)?;
    }
    Ok(())
}
