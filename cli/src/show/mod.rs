//! Answers as text for people, in tables that fit a terminal. `live` shows several states at once.

mod front;
mod live;
pub(crate) mod space;

use std::fmt::Write as _;

use comfy_table::{Cell, CellAlignment, ContentArrangement, LineStyle, Table, presets};
use treewright_client::{
    Best, Configuration, CostView, OpenEnum, Outcome, Policy, Prediction, Scale, Standing, StandingVerdict,
    StudyRecord, StudySpec, TrialRecord,
};

pub(crate) use front::{front, front_svg};
pub(crate) use live::{Glance, best_of_states, glance};

/// A table whose columns with the given numbers hold figures. It fits the terminal; in a pipe, where the
/// reader wants whole words, it is as wide as it has to be.
fn table(header: &[&str], figures: &[usize]) -> Table {
    let mut table = Table::new();
    let style = presets::UTF8_HORIZONTAL_ONLY.row_separator(LineStyle::none());
    table.load_style(style).set_content_arrangement(ContentArrangement::Dynamic);
    if table.width().is_none() {
        table.set_content_arrangement(ContentArrangement::Disabled);
    }
    table.set_header(header.iter().map(Cell::new).collect::<Vec<_>>());
    for &index in figures {
        if let Some(column) = table.column_mut(index) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// How a study's costs are shown: as plain costs where its objective cannot be read.
pub(crate) fn view(study: &StudyRecord) -> CostView {
    study.spec().map(|spec| spec.objective.view()).unwrap_or_default()
}

pub(crate) fn studies(studies: &[StudyRecord]) -> String {
    let header = ["study", "states", "trials", "completed", "open", "created", "what", "tags"];
    let mut table = table(&header, &[1, 2, 3, 4]);
    for study in studies {
        let counts = study.statistics;
        table.add_row([
            study.id().to_owned(),
            counts.states.to_string(),
            counts.trials.to_string(),
            counts.completed_trials.to_string(),
            counts.open_trials.to_string(),
            // The day, so that the table is narrow.
            time(study.create_time).chars().take(10).collect(),
            study.display_name.clone(),
            tags(study),
        ]);
    }
    table.trim_fmt()
}

/// The standing of each study: the number of its states at each standing, and the median of their gains.
pub(crate) fn standings(studies: &[(StudyRecord, Vec<Best>)]) -> String {
    let [proven, likely, nothing] =
        [StandingVerdict::Proven, StandingVerdict::Likely, StandingVerdict::NothingBetter]
            .map(StandingVerdict::in_short);
    let header = ["study", "states", proven, likely, nothing, "going on", "median gain %"];
    let mut table = table(&header, &[1, 2, 3, 4, 5, 6]);
    for (study, found) in studies {
        let standings: Vec<&Standing> = found.iter().filter_map(|best| best.standing.as_ref()).collect();
        // In the words of all surfaces: a search goes on while a race still decides.
        let count = |verdicts: &[StandingVerdict]| {
            let is_one =
                |standing: &&&Standing| verdicts.iter().any(|one| one.in_short() == standing.in_short());
            standings.iter().filter(is_one).count()
        };
        let [proven, likely] = [StandingVerdict::Proven, StandingVerdict::Likely].map(|one| count(&[one]));
        let nothing = count(&[StandingVerdict::NothingBetter, StandingVerdict::NothingToWin]);
        let view = view(study);
        let mut gains: Vec<f64> =
            standings.iter().filter_map(|standing| Some(standing.gain?.share)).collect();
        gains.sort_by(f64::total_cmp);
        table.add_row([
            study.id().to_owned(),
            study.statistics.states.to_string(),
            proven.to_string(),
            likely.to_string(),
            nothing.to_string(),
            (standings.len() - proven - likely - nothing).to_string(),
            gains.get(gains.len() / 2).map(|gain| view.percent(*gain)).unwrap_or_default(),
        ]);
    }
    table.trim_fmt()
}

fn tags(study: &StudyRecord) -> String {
    study.tags.iter().cloned().collect::<Vec<_>>().join(", ")
}

pub(crate) fn texts(study: &StudyRecord) -> String {
    let mut text = String::new();
    line(&mut text, &format!("{}  {}", study.name, study.display_name));
    study.note.lines().for_each(|said| line(&mut text, &format!("  {said}")));
    if !study.tags.is_empty() {
        line(&mut text, &format!("tagged {}", tags(study)));
    }
    text
}

pub(crate) fn study(study: &StudyRecord, found: &[Best]) -> String {
    let mut text = texts(study);
    let counts = study.statistics;
    let (states, trials, completed, open) =
        (counts.states, counts.trials, counts.completed_trials, counts.open_trials);
    line(
        &mut text,
        &format!(
            "created {}; {states} states, {trials} trials, {completed} completed, {open} open",
            time(study.create_time)
        ),
    );
    if study.space_revision > 1 {
        line(&mut text, &format!("revision {} of its space", study.space_revision));
    }
    if !found.is_empty() {
        text += &best_of_states(found, study);
    }
    match study.spec() {
        Ok(spec) => text.push_str(&specification(spec)),
        Err(problem) => line(&mut text, &format!("what is tuned cannot be read: {problem}")),
    }
    text + &policy(&study.policy)
}

fn specification(spec: &StudySpec) -> String {
    let mut text = String::new();
    let mut parameters = table(&["parameter", "default", "values", "only if"], &[]);
    for parameter in spec.space.parameters() {
        let condition = parameter.active_if.as_ref().map(ToString::to_string).unwrap_or_default();
        let (default, domain) = (parameter.default.to_string(), parameter.domain.to_string());
        parameters.add_row([parameter.name.clone(), default, domain, condition]);
    }
    line(&mut text, &parameters.trim_fmt());
    let setup: Vec<&str> = spec.space.setup_parameters().map(|parameter| parameter.name.as_str()).collect();
    if !setup.is_empty() {
        line(&mut text, &format!("a change of {} needs a set-up", setup.join(", ")));
    }
    for constraint in spec.space.constraints() {
        line(&mut text, &format!("always {constraint}"));
    }
    if !spec.indicators.indicators().is_empty() {
        let mut indicators = table(&["indicator", "0 at", "1 at", "scale"], &[1, 2]);
        for indicator in spec.indicators.indicators() {
            let scale = if indicator.scale == Scale::Log { "log" } else { "linear" };
            let [min, max] = [indicator.min, indicator.max].map(figure);
            indicators.add_row([indicator.name.clone(), min, max, scale.to_owned()]);
        }
        line(&mut text, &indicators.trim_fmt());
        line(&mut text, &format!("inputs are one state within {}", figure(spec.state_tolerance)));
    }
    line(&mut text, &spec.objective.to_string());
    text
}

pub(crate) fn policy(policy: &Policy) -> String {
    let mut table = table(&["policy", "value"], &[]);
    for field in Policy::FIELDS {
        let value = policy.show(field.name).unwrap_or_else(|| format!("{} (default)", field.unset));
        table.add_row([field.name.to_owned(), value]);
    }
    table.trim_fmt()
}

pub(crate) fn trials(trials: &[TrialRecord], limit: usize, is_by_number: bool, view: &CostView) -> String {
    if trials.is_empty() {
        return "no such trials".to_owned();
    }
    let header = ["trial", "state", "mode", "outcome", &view.title(), "configuration"];
    let mut table = table(&header, &[0, 1, 4]);
    for trial in trials {
        // Of a completed trial the outcome says more than that it is complete.
        let ended =
            trial.outcome.as_ref().map_or_else(|| trial.state.to_string(), |ended| outcome(ended, view));
        table.add_row([
            trial.number().map_or_else(|| trial.name.clone(), |number| number.to_string()),
            trial.state_id.to_string(),
            trial.mode.to_string(),
            ended
                + if trial.late { " (late)" } else { "" }
                + if trial.exclusion.is_some() { " (excluded)" } else { "" },
            trial.cost.map_or_else(String::new, |cost| figure(view.value(cost))),
            trial.configuration.to_string(),
        ]);
    }
    let last = trials.last().and_then(TrialRecord::number).filter(|_| is_by_number);
    let more = match (trials.len() == limit, last) {
        (false, _) => String::new(),
        (true, Some(last)) => {
            format!("\nthe first {limit}; the next ones with --after {last}, more with --limit")
        }
        (true, None) => format!("\nthe first {limit}; see more with --limit"),
    };
    table.trim_fmt() + &more
}

pub(crate) fn trial(trial: &TrialRecord, view: &CostView) -> String {
    let mut text = String::new();
    line(&mut text, &format!("{}  {} {}", trial.name, trial.mode, trial.state));
    line(&mut text, &format!("of {} in state {}", trial.client_id, trial.state_id));
    line(&mut text, &format!("configuration {}", trial.configuration));
    let pairs = |values: Vec<String>| values.join(" ");
    let indicators =
        pairs(trial.indicators.iter().map(|(name, value)| format!("{name}={}", figure(value))).collect());
    if !indicators.is_empty() {
        line(&mut text, &format!("indicators {indicators}"));
    }
    if let Some(ended) = &trial.outcome {
        let error = |name: &str| trial.standard_errors.get(name).map(|error| format!("±{}", figure(error)));
        let measured = trial.measurements.iter();
        let measured = measured
            .map(|(name, value)| format!("{name}={}{}", figure(value), error(name).unwrap_or_default()));
        line(&mut text, &format!("{} {}", outcome(ended, view), pairs(measured.collect())));
    }
    if let Some(cost) = trial.cost {
        let shown = |cost: f64| figure(view.value(cost));
        let predicted =
            trial.predicted_cost.map(|cost| format!(", predicted {}", shown(cost))).unwrap_or_default();
        line(&mut text, &format!("{} {}{predicted}", view.name(), shown(cost)));
    }
    let reason = &trial.reason;
    let step = if reason.step.is_empty() { String::new() } else { format!(" ({})", reason.step) };
    line(&mut text, &format!("chosen by {}{step}: {}", reason.source, reason.summary));
    if let Some(rule) = &reason.explanation.rule {
        line(&mut text, &format!("by the rule {rule}"));
    }
    if let Some(origin) = &trial.origin {
        line(&mut text, &format!("measured as {origin}"));
    }
    if let Some(reason) = &trial.exclusion {
        line(&mut text, &format!("excluded: {reason}"));
    }
    line(
        &mut text,
        &format!("handed out {}, reported {}", time(trial.create_time), time(trial.complete_time)),
    );
    text
}

pub(crate) fn ping(url: &str, round_trip_ms: f64) -> String {
    format!("{url} is serving; a round trip takes {round_trip_ms:.2} ms")
}

/// An outcome as table columns: its word, its reason, its lower bound.
pub(crate) fn outcome_parts(outcome: Option<&OpenEnum<Outcome>>) -> (String, String, Option<f64>) {
    let word = |outcome: &Outcome| outcome.kind().to_string();
    match outcome {
        None => Default::default(),
        Some(OpenEnum::Unrecognised(_)) => ("UNRECOGNISED".to_owned(), String::new(), None),
        Some(OpenEnum::Known(outcome)) => match outcome {
            Outcome::Ok => (word(outcome), String::new(), None),
            Outcome::Infeasible { reason } | Outcome::Failed { reason } => {
                (word(outcome), reason.clone(), None)
            }
            Outcome::Aborted { lower_bound } => (word(outcome), String::new(), Some(*lower_bound)),
        },
    }
}

pub(crate) fn best(best: &Best, spec: &StudySpec) -> String {
    let view = spec.objective.view();
    let mut text = match &best.standing {
        Some(standing) => stands(standing, best, &view),
        None => means(best, &view),
    };
    line(&mut text, &format!("last measured by {} at {}", best.trial, time(best.last_measure_time)));
    text + &beside_default("best", &best.configuration, spec) + "\n"
}

/// The standing of the best: costs and gains are estimates with 95 % intervals.
fn stands(standing: &Standing, best: &Best, view: &CostView) -> String {
    let mut text = String::new();
    let (low, high) = view.interval(standing.cost_low, standing.cost_high);
    line(
        &mut text,
        &format!(
            "{} {} [{}, {}] in state {}, {} measurement(s)",
            view.title(),
            figure(view.value(standing.cost)),
            figure(low),
            figure(high),
            best.state_id,
            best.measurements
        ),
    );
    // The default itself is not compared with the default.
    if let Some(gain) = standing.gain.as_ref().filter(|gain| gain.share != 0.0 || gain.low != gain.high) {
        let chance = gain
            .probability_better
            .map(|chance| format!(", better with probability {chance:.2}"))
            .unwrap_or_default();
        let (gain, side) = (gain.by(view), view.better_side());
        line(&mut text, &format!("{gain} {side} the default (95 % interval){chance}"));
    }
    line(&mut text, &standing.sentence_by(view));
    text
}

/// Mean measurements, from a daemon that does not send standings.
fn means(best: &Best, view: &CostView) -> String {
    let mut text = String::new();
    let Best { cost, measurements, state_id, .. } = best;
    let cost = format!("{} {}", view.title(), figure(view.value(*cost)));
    line(&mut text, &format!("{cost} over {measurements} measurement(s) in state {state_id}"));
    if let Some(default) = best.default_cost
        && default > 0.0
    {
        let gain = view.percent(1.0 - best.cost / default);
        let (default, side) = (figure(view.value(default)), view.better_side());
        line(&mut text, &format!("default {default}, so the best is {gain} % {side} it"));
    }
    text
}

pub(crate) fn prediction(prediction: &Prediction, spec: &StudySpec) -> String {
    let mut text = String::new();
    let view = spec.objective.view();
    let shown = |cost: f64| figure(view.value(cost));
    let cost = prediction.predicted_cost.map_or_else(|| "unknown".to_owned(), shown);
    line(&mut text, &format!("mode {}, predicted {} {cost}", prediction.mode, view.title()));
    if !prediction.reason.summary.is_empty() {
        line(&mut text, &prediction.reason.summary);
    }
    if !prediction.reason.neighbours.is_empty() {
        let header = ["near state", "distance", &format!("best {} there", view.name())];
        let mut neighbours = table(&header, &[0, 1, 2]);
        for near in &prediction.reason.neighbours {
            neighbours.add_row([near.state_id.to_string(), figure(near.distance), shown(near.best_cost)]);
        }
        line(&mut text, &neighbours.trim_fmt());
    }
    text + &beside_default("predicted", &prediction.configuration, spec) + "\n"
}

/// Why a state is answered as it is.
pub(crate) fn explanation(prediction: &Prediction, view: &CostView) -> String {
    let mut text = String::new();
    let source = if prediction.reason.source.is_empty() { "?" } else { &prediction.reason.source };
    line(&mut text, &format!("answer: {}", prediction.configuration));
    line(&mut text, &format!("by {source}: {}", prediction.reason.summary));
    let weighed = &prediction.reason.explanation;
    if let Some(rule) = &weighed.rule {
        line(&mut text, &format!("by the rule {}", rule));
    }
    let Some(state) = &prediction.state else {
        line(&mut text, "this state was never met");
        return text;
    };
    line(
        &mut text,
        &format!(
            "state {}: {} configurations tried, {} visits, {} frames, {} outliers, {} drifts",
            state.state_id, state.tried, state.visits, state.frames, state.outliers, state.drifts
        ),
    );
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    if let Some(standing) = &state.standing {
        line(&mut text, &standing.sentence_by(view));
    }
    if let Some(noise) = state.noise {
        line(&mut text, &format!("repeated measurements differ by {}", percent(noise)));
    }
    if let (Some(gain), Some(frames), Some(cost)) =
        (state.expected_gain, state.expected_frames, state.exploring_cost)
    {
        line(
            &mut text,
            &format!(
                "exploring on is expected to gain {} % in each of {frames:.0} frames, and to cost as much as {cost:.1} frames",
                view.percent(gain)
            ),
        );
    }
    if !state.omissions.is_empty() {
        let mut omissions = table(&["left out", "why", "trials saved"], &[2]);
        for omission in &state.omissions {
            let what = omission.parameter.clone().unwrap_or_else(|| "the whole search".to_owned());
            omissions.add_row([what, omission.summary.clone(), format!("{:.1}", omission.saved_trials)]);
        }
        line(&mut text, &omissions.trim_fmt());
    }
    text
}

/// A configuration in the space's order, beside the recommended values.
fn beside_default(name: &str, configuration: &Configuration, spec: &StudySpec) -> String {
    let mut table = table(&["parameter", name, "default"], &[]);
    for parameter in spec.space.parameters() {
        let value =
            configuration.get(&parameter.name).map_or_else(|| "(inactive)".to_owned(), ToString::to_string);
        table.add_row([parameter.name.clone(), value, parameter.default.to_string()]);
    }
    table.trim_fmt()
}

fn outcome(outcome: &OpenEnum<Outcome>, view: &CostView) -> String {
    let OpenEnum::Known(outcome) = outcome else { return "unrecognised".to_owned() };
    match outcome {
        Outcome::Ok => "OK".to_owned(),
        Outcome::Infeasible { reason } => format!("INFEASIBLE: {reason}"),
        Outcome::Aborted { lower_bound } => {
            format!("ABORTED: {} {}", view.bound(), figure(view.value(*lower_bound)))
        }
        Outcome::Failed { reason } => format!("FAILED: {reason}"),
    }
}

/// About five significant digits, without an exponent where that stays short.
pub(crate) fn figure(value: f64) -> String {
    let size = value.abs();
    if value == value.trunc() && size < 1e15 {
        return format!("{value:.0}");
    }
    match size {
        10_000.0.. => format!("{value:.0}"),
        0.001..10_000.0 => {
            let whole_digits = if size >= 1000.0 {
                4
            } else if size >= 100.0 {
                3
            } else if size >= 10.0 {
                2
            } else {
                1
            };
            format!("{value:.*}", 5 - whole_digits)
        }
        _ => format!("{value:.4e}"),
    }
}

pub(crate) fn time(time: Option<std::time::SystemTime>) -> String {
    time.map_or_else(String::new, |time| humantime::format_rfc3339_seconds(time).to_string())
}

fn line(text: &mut String, more: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{}", more.trim_end());
}

#[cfg(test)]
mod tests {
    use treewright_client::{Confirmation, ConfirmationStage, Gain, SpaceBuilder};

    use super::*;

    /// A study that maximises a rate, and the best of it: 50 frames a second, where the default has 40.
    fn best_rate() -> (StudySpec, Best) {
        let space = SpaceBuilder::new().integer("level", 1..=9).default(3).build().expect("sound");
        let spec = StudySpec::builder(space).maximise("fps", 1000.0).build().expect("sound");
        let gain = Gain { share: 0.2, low: Some(0.0), high: Some(0.5), probability_better: None };
        let (stage, gain) = (ConfirmationStage::Searching, Some(gain));
        let confirmation = Confirmation { stage, ..Confirmation::default() };
        let (cost, cost_low, cost_high) = (20.0, 12.5, 25.0);
        let standing = Standing { cost, cost_low, cost_high, gain, confirmation, ..Standing::default() };
        let best = Best {
            configuration: Configuration::new().with("level", 5),
            cost: 20.0,
            default_cost: Some(25.0),
            measurements: 4,
            state_id: 1,
            trial: "studies/rates/trials/7".into(),
            last_measure_time: None,
            standing: Some(standing),
        };
        (spec, best)
    }

    #[test]
    fn what_is_maximised_is_told_by_its_value_and_direction() {
        let (spec, known) = best_rate();
        let printed = best(&known, &spec);
        assert!(
            printed.starts_with("fps (higher is better) 50 [40, 80] in state 1, 4 measurement(s)"),
            "{printed}"
        );
        assert!(printed.contains("25.0 % [0.0, 100.0] above the default (95 % interval)"), "{printed}");
        let printed = best(&Best { standing: None, ..known.clone() }, &spec);
        assert!(printed.contains("fps (higher is better) 50 over 4"), "{printed}");
        assert!(printed.contains("default 40, so the best is 25.0 % above it"), "{printed}");
        let rows = live::rows(&[known], Some(&spec));
        for word in ["fps (higher is better)", "above the default", " 50 ", "25.0 % [0.0, 100.0]"] {
            assert!(rows.contains(word), "{word} is not in {rows}");
        }
        assert!(specification(&spec).contains("maximises fps"));
        let bound = OpenEnum::Known(Outcome::aborted(25.0));
        assert_eq!(outcome(&bound, &spec.objective.view()), "ABORTED: at most 40");
        assert_eq!(outcome(&bound, &CostView::default()), "ABORTED: at least 25");
    }

    #[test]
    fn figures_are_short() {
        let shown: Vec<_> = [0.0, 12.0, 12.345_678, 0.012_345_6, 123_456.7, 1e-9, -3.25, 1e20]
            .into_iter()
            .map(figure)
            .collect();
        assert_eq!(
            shown,
            ["0", "12", "12.346", "0.0123", "123457", "1.0000e-9", "-3.2500", "100000000000000000000"]
        );
    }
}
