//! Values that are written by their names, and numbers of a range.

use std::{ops::RangeInclusive, str::FromStr};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Reads one of some values by its name. Each comes with its text for `--help`.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static, const N: usize>(
    values: [(T, &'static str, &'static str); N],
) -> impl TypedValueParser<Value = T> {
    let names = values.map(|(_, name, about)| PossibleValue::new(name).help(about));
    PossibleValuesParser::new(names).map(move |text| {
        let named = values.iter().find(|(_, name, _)| *name == text);
        named.expect("clap passes on what is possible").0
    })
}

/// A number of a range, which the error calls `wanted`.
pub(crate) fn number_within<T: FromStr + PartialOrd>(
    text: &str,
    range: RangeInclusive<T>,
    wanted: &str,
) -> Result<T, String> {
    let number = text.parse::<T>().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("it must be {wanted}"))
}
