//! Effects of parameters on the cost in one state: importances, parallel coordinates, slices, contour.

use askama::Template;
use treewright_core::cost_view::CostView;
use treewright_core::space::Parameter;
use treewright_proto::convert::configuration_from_wire;
use treewright_proto::v1;

use super::super::stats::{self, Run};
use super::super::{Query, Visitor, charts};
use super::{Head, PageFrame, TRIALS, asked_axis, asked_state, head, read_trials, render};
use crate::error::Result;

/// Most parameters in pictures: the most important.
const PARAMETERS: usize = 12;
/// Most axes of parallel coordinates that can be read at the width of a screen.
const AXES: usize = 10;

#[derive(Template)]
#[template(path = "parameters.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    state_text: String,
    note: Option<String>,
    has_trials: bool,
    importances: String,
    parallel: String,
    slices: Vec<(String, String)>,
    names: Vec<String>,
    x: String,
    y: String,
    contour: String,
    leaf_sizes: String,
}

pub(in super::super) async fn parameters(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String> {
    let (mut head, study) = head(visitor, id, "parameters").await?;
    query.only(&["state", "x", "y"])?;
    let id = super::id(&study.name);
    let spec = visitor.tuning.get_study(id).await?.spec;
    let all = spec.space.parameters();
    let state = match asked_state(query, "state", head.states)? {
        Some(state) => Some(state),
        None => read_trials(visitor, id, "", "number desc", 1).await?.first().map(|trial| trial.state_id),
    };
    let runs: Vec<Run> = match state {
        None => Vec::new(),
        Some(state) => {
            let filter = format!("state_id = {state} AND outcome = OK");
            let trials = read_trials(visitor, id, &filter, "number desc", TRIALS).await?;
            trials.iter().filter_map(|trial| run(all, trial)).collect()
        }
    };
    head.query = state.map(|state| format!("?state={state}")).unwrap_or_default();
    let note = match (state, runs.len()) {
        (None, _) => Some("No trials yet.".to_owned()),
        (Some(state), 0) => Some(format!("Nothing was measured in state {state}.")),
        (Some(state), count) => Some(format!("{count} measurements in state {state}.")),
    };
    let importances = stats::importances(all, &runs);
    let shown = shown(all, &importances);
    let axes = contour_axes(all, &shown, query)?;
    let name = |pick: fn(&(usize, usize)) -> usize| axes.as_ref().map(|axes| all[pick(axes)].name.clone());
    let view = head.view.clone();
    let page = Page {
        frame: visitor.frame,
        head,
        names: all.iter().map(|parameter| parameter.name.clone()).collect(),
        x: name(|axes| axes.0).unwrap_or_default(),
        y: name(|axes| axes.1).unwrap_or_default(),
        leaf_sizes: leaf_sizes(all).map(|axes| contour(all, axes, &runs, &view)).unwrap_or_default(),
        state_text: state.map(|state| state.to_string()).unwrap_or_default(),
        note,
        has_trials: !runs.is_empty(),
        importances: charts::bars(&importances[..importances.len().min(PARAMETERS)]),
        parallel: parallel(all, &shown[..shown.len().min(AXES)], &runs),
        slices: shown.iter().map(|&index| slice(&all[index], index, &runs, &view)).collect(),
        contour: axes.map(|axes| contour(all, axes, &runs, &view)).unwrap_or_default(),
    };
    render(&page)
}

/// A trial of an earlier space may have a value that the present one does not have; it is left out.
fn run(parameters: &[Parameter], trial: &v1::Trial) -> Option<Run> {
    let values = configuration_from_wire("configuration", trial.configuration.clone()?).ok()?;
    let place = |parameter: &Parameter| match values.get(&parameter.name) {
        Some(value) => stats::place(parameter, value).map(Some),
        None => Some(None),
    };
    Some((parameters.iter().map(place).collect::<Option<_>>()?, trial.cost?))
}

/// The parameters in pictures, the most important first.
fn shown(all: &[Parameter], importances: &[(String, f64)]) -> Vec<usize> {
    let by_name = |name: &String| all.iter().position(|parameter| parameter.name == *name);
    let mut order: Vec<usize> = importances.iter().filter_map(|(name, _)| by_name(name)).collect();
    assert!(order.is_empty() || order.len() == all.len(), "{} of {} parameters", order.len(), all.len());
    if order.is_empty() {
        order = (0..all.len()).collect();
    }
    order.truncate(PARAMETERS);
    order
}

fn parallel(all: &[Parameter], shown: &[usize], runs: &[Run]) -> String {
    let axes: Vec<_> = shown.iter().map(|&index| stats::axis(&all[index])).collect();
    let mut costs: Vec<f64> = runs.iter().map(|run| run.1).collect();
    costs.sort_by(f64::total_cmp);
    let lines: Vec<_> = runs
        .iter()
        .map(|(places, cost)| {
            (shown.iter().map(|&index| places[index]).collect(), charts::rank(&costs, *cost))
        })
        .collect();
    charts::parallel(&axes, &lines)
}

fn slice(parameter: &Parameter, index: usize, runs: &[Run], view: &CostView) -> (String, String) {
    let points: Vec<_> = runs.iter().filter_map(|(places, cost)| Some((places[index]?, *cost))).collect();
    (parameter.name.clone(), charts::slice(&stats::axis(parameter), &points, view))
}

/// The axes of the contour: the requested ones, else the two that explain most; `None` with a single
/// parameter.
fn contour_axes(all: &[Parameter], shown: &[usize], query: &Query) -> Result<Option<(usize, usize)>> {
    let names = || all.iter().map(|parameter| parameter.name.as_str());
    let axes = (asked_axis(query, "x", names())?, asked_axis(query, "y", names())?, shown);
    Ok(match axes {
        (Some(x), Some(y), _) => Some((x, y)),
        (_, _, [x, y, ..]) => Some((*x, *y)),
        _ => None,
    })
}

/// The fewest and the most primitives of a leaf, in studies of trees (the paper's figure 5).
fn leaf_sizes(all: &[Parameter]) -> Option<(usize, usize)> {
    let named = |name: &str| all.iter().position(|parameter| parameter.name == name);
    named("min_leaf_size").zip(named("max_leaf_size"))
}

fn contour(all: &[Parameter], (x, y): (usize, usize), runs: &[Run], view: &CostView) -> String {
    let points: Vec<_> =
        runs.iter().filter_map(|(places, cost)| Some((places[x]?, places[y]?, *cost))).collect();
    charts::contour(&stats::axis(&all[x]), &stats::axis(&all[y]), &points, view)
}
