//! One flag for each field of a policy, made from the model's table of fields.

use clap::builder::{PossibleValuesParser, ValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches};
use treewright_client::{Policy, PolicyField};

#[derive(Debug, Default)]
pub(crate) struct SettingFlags(pub(crate) Policy);

/// All but `pinned`, which is given parameter by parameter.
fn fields() -> impl Iterator<Item = &'static PolicyField> {
    Policy::FIELDS.iter().filter(|field| field.name != "pinned")
}

/// The arguments of which a change of policy needs one.
pub(crate) fn change_arguments() -> Vec<&'static str> {
    fields().map(|field| field.name).chain(["preset", "pin", "unpin", "clear"]).collect()
}

fn flag(field: &'static PolicyField) -> Arg {
    let words = (field.words)();
    let parser: ValueParser = if words.is_empty() {
        let read = |text: &str| match Policy::new().set_text(field.name, text) {
            Ok(()) => Ok(text.to_owned()),
            Err(error) => Err(error.to_string()),
        };
        read.into()
    } else {
        PossibleValuesParser::new(words.into_iter().map(|word| word.replace('_', "-"))).into()
    };
    let help = format!("{}; unset: {}", field.summary(), field.unset);
    Arg::new(field.name)
        .long(field.name.replace('_', "-"))
        .value_name(field.placeholder)
        .help(help)
        .value_parser(parser)
}

impl Args for SettingFlags {
    fn augment_args(command: Command) -> Command {
        let preset = Arg::new("preset")
            .long("preset")
            .value_name("NAME")
            .help(
                "Set all fields of a preset; fields that are named beside it win. `paper` tunes as published",
            )
            .value_parser(PossibleValuesParser::new(Policy::PRESETS));
        let command = command.arg(preset);
        fields().fold(command, |command, field| command.arg(flag(field)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut flags = Self::default();
        flags.update_from_arg_matches(matches)?;
        Ok(flags)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        if let Some(name) = matches.get_one::<String>("preset") {
            let preset = Policy::preset(name);
            self.0 = preset.map_err(|error| Error::raw(ErrorKind::ValueValidation, format!("{error}\n")))?;
        }
        for field in fields() {
            if let Some(text) = matches.get_one::<String>(field.name) {
                let set = self.0.set_text(field.name, text);
                set.map_err(|error| Error::raw(ErrorKind::ValueValidation, format!("{error}\n")))?;
            }
        }
        Ok(())
    }
}
