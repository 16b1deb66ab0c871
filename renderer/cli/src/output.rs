//! The output that all commands share: JSON, tables, progress bars.

use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::error::{CliError, Result};
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};
use treewright_renderer::{integrator::Omission, measure::Standing};
use treewright_scene::Scene;

/// Prints a value as indented JSON.
pub fn json(value: &impl Serialize) -> Result<()> {
    println!("{}", to_json(value)?);
    Ok(())
}

/// A value as indented JSON.
pub fn to_json(value: &impl Serialize) -> Result<String> {
    serde_json::to_string_pretty(value)
        .map_err(|error| CliError::Failed(format!("the results cannot be written as JSON: {error}")))
}

/// A progress bar on standard error; invisible where that is no terminal.
pub fn bar(length: u64, unit: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    let template = format!("{{bar:30}} {{pos}}/{{len}} {unit}  {{msg}}");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.progress_chars("━━ "));
    }
    bar
}

/// A table with a heading; all columns but the first are numbers.
pub fn table(heading: &[&str]) -> Table {
    let mut table = Table::new();
    table
        .load_style(presets::UTF8_HORIZONTAL_ONLY.row_separator(LineStyle::none()))
        .set_content_arrangement(ContentArrangement::Dynamic);
    table.set_header(heading.iter().copied());
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// The contenders that every table compares the others with.
const REFERENCES: [(Who, &str); 3] = [
    (NATIVE_DEFAULT, "over native default"),
    (Who::UsedWell, "over native used well"),
    (Who::BestFixed, "over best fixed"),
];

/// Measured structures, each compared with those that need no search. `kind` names the parts of a frame.
pub fn standings(standings: &[Standing], kind: &str) -> Table {
    let find = |who: Who| standings.iter().find(|one| one.who == who);
    let references: Vec<(&Standing, &str)> =
        REFERENCES.into_iter().filter_map(|(who, title)| Some((find(who)?, title))).collect();
    let mut heading = vec!["structure", "build ms", kind, "quartiles"];
    heading.extend(references.iter().map(|(_, title)| *title));
    let mut table = table(&heading);
    for one in standings {
        if let Some(failure) = &one.failure {
            table.add_row([one.title(), failure.clone()]);
            continue;
        }
        let mut row = vec![
            one.title(),
            format!("{:.1}", one.build_ms.median),
            format!("{:.1}", one.frame_ms.median),
            format!("{:.1} – {:.1}", one.frame_ms.lower_quartile, one.frame_ms.upper_quartile),
        ];
        row.extend(references.iter().map(|(reference, _)| one.gain_over(reference).to_string()));
        table.add_row(row);
    }
    table
}

/// Prints the features that shading leaves out on a scene.
pub fn left_out(omissions: &[Omission]) {
    for omission in omissions {
        println!("left out: {}; {}", omission.what, omission.why);
    }
}

/// Prints the omissions and additions of a scene's loader.
pub fn notes(scene: &Scene) {
    for note in &scene.notes {
        println!("note: {note}");
    }
}

/// A sign of life on standard error while something takes its time.
pub fn spinner(message: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(message);
    spinner.enable_steady_tick(std::time::Duration::from_millis(200));
    spinner
}
