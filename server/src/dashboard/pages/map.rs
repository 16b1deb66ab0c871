//! The context map: the states of a study by two of their indicators, coloured by gain, cost, or a
//! parameter's value in the best configuration there.

use askama::Template;
use treewright_core::indicator::Indicator;
use treewright_proto::v1;

use super::super::charts::{self, Axis, Place, figure};
use super::super::{Query, Visitor, stats};
use super::standing::{StateStands, read_state};
use super::{Head, PageFrame, head, render};
use crate::error::Error;

/// Most states on a map.
const STATES: i64 = 120;

#[derive(Template)]
#[template(path = "map.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    indicators: Vec<String>,
    shows: Vec<String>,
    x: String,
    y: String,
    show: String,
    picture: String,
    is_cut: bool,
}

pub(in super::super) async fn map(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String, Error> {
    let (head, _) = head(visitor, id, "map").await?;
    let spec = visitor.tuning.get_study(id).await?.spec;
    let indicators = spec.indicators.indicators();
    let parameters = spec.space.parameters();
    let mut states = Vec::new();
    for number in 1..=head.states.min(STATES) {
        states.extend(read_state(visitor, id, number).await?);
    }
    let (first, second) = widest(indicators, &states);
    assert!(first.max(second) < indicators.len().max(1), "{first} and {second} of {}", indicators.len());
    assert!(first != second || indicators.len() < 2, "indicator {first} is both axes");
    let named = |asked: &str, otherwise: usize| {
        let position = indicators.iter().position(|indicator| indicator.name == query.text(asked));
        position.unwrap_or(otherwise)
    };
    let (x, y) = (named("x", first), named("y", second));
    let view = &head.view;
    let shows: Vec<String> = ["gain".to_owned(), view.name().to_owned()]
        .into_iter()
        .chain(parameters.iter().map(|parameter| parameter.name.clone()))
        .collect();
    let asked = query.text("show");
    let show = if shows.contains(&asked) { asked } else { "gain".to_owned() };
    let parameter = parameters.iter().find(|parameter| parameter.name == show);
    let told = |of: &StateStands| match (show.as_str(), parameter) {
        (_, Some(parameter)) => {
            let values = &of.best.as_ref()?.configuration.as_ref()?.values;
            let value = values.get(&parameter.name)?;
            let words = format!("{}={}", parameter.name, super::value(value));
            let value = treewright_proto::convert::value_from_wire("value", value.clone()).ok()?;
            Some((stats::place(parameter, &value), words))
        }
        (name, None) if name == view.name() => of.standing.map(|standing| {
            (standing.cost, format!("{} {}", view.title(), figure(view.value(standing.cost))))
        }),
        _ => of
            .standing?
            .gain
            .map(|gain| (-gain.share, format!("{} {} the default", gain.by(view), view.better_side()))),
    };
    let at =
        |of: &StateStands, index: usize| indicators.get(index).map_or(0.5, |one| position(one, &of.trial));
    let places: Vec<Place> = states
        .iter()
        .filter_map(|of| {
            let (rank, words) = told(of)?;
            let link = format!("/studies/{id}?state={}#curve", of.state);
            Some(Place { state: of.state, x: at(of, x), y: at(of, y), rank, words, link })
        })
        .collect();
    let picture = match (indicators.get(x), indicators.get(y)) {
        (Some(x), Some(y)) => charts::map(&axis(x), &axis(y), &places),
        _ => String::new(),
    };
    let name = |index: usize| indicators.get(index).map(|one| one.name.clone()).unwrap_or_default();
    let page = Page {
        frame: visitor.frame,
        is_cut: head.states > STATES,
        indicators: indicators.iter().map(|indicator| indicator.name.clone()).collect(),
        shows,
        x: name(x),
        y: name(y),
        show,
        picture,
        head,
    };
    render(&page)
}

/// The place of a trial's indicator between its ends, on its own scale.
fn position(indicator: &Indicator, trial: &v1::Trial) -> f64 {
    let value = trial.indicators.get(&indicator.name).copied().unwrap_or(indicator.min);
    indicator.normalise(value).clamp(0.0, 1.0)
}

/// Two indicators that separate the states: the one by which they differ most, and the one that differs most
/// apart from it. A linear function of the first would place all states on one line.
fn widest(indicators: &[Indicator], states: &[StateStands]) -> (usize, usize) {
    let columns: Vec<Vec<f64>> = indicators
        .iter()
        .map(|indicator| {
            let places: Vec<f64> = states.iter().map(|of| position(indicator, &of.trial)).collect();
            let mean = places.iter().sum::<f64>() / places.len().max(1) as f64;
            places.into_iter().map(|place| place - mean).collect()
        })
        .collect();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let spread = |column: &[f64]| product(column, column);
    let most = |of: &dyn Fn(&[f64]) -> f64| {
        let spreads = columns.iter().map(|column| of(column)).enumerate();
        spreads.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))).map_or(0, |(index, _)| index)
    };
    let first = most(&spread);
    let Some(along) = columns.get(first).filter(|along| spread(along) > 0.0) else {
        return (0, usize::from(indicators.len() > 1));
    };
    let second = most(&|column| spread(column) - product(column, along).powi(2) / spread(along));
    if second == first { (first, usize::from(first == 0 && indicators.len() > 1)) } else { (first, second) }
}

fn axis(indicator: &Indicator) -> Axis {
    Axis { name: indicator.name.clone(), low: figure(indicator.min), high: figure(indicator.max) }
}
