//! The context map: the states of a study by two of their indicators, coloured by gain, cost, or a
//! parameter's value in the best configuration there.

use askama::Template;
use treewright_core::cost_view::CostView;
use treewright_core::indicator::Indicator;
use treewright_core::space::Parameter;
use treewright_proto::v1;

use super::super::charts::{self, Axis, Place, figure};
use super::super::{Query, Visitor, stats};
use super::standing::{StateStands, read_state};
use super::{Head, PageFrame, asked_axis, head, render};
use crate::error::{Error, Result};

/// Most states on a map.
const STATES: i64 = 120;

#[derive(Template)]
#[template(path = "map.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    indicators: Vec<String>,
    /// The names of the parameters, and whether the states are coloured by each.
    parameters: Vec<(String, bool)>,
    x: String,
    y: String,
    is_gain: bool,
    is_cost: bool,
    picture: String,
    is_cut: bool,
}

/// The quantity that colours the states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    Gain,
    /// The objective, in the study's view.
    Cost,
    /// The parameter of this index.
    Parameter(usize),
}

impl Shown {
    /// Reads what an address asks for: `gain`, `cost` or `config.NAME`, whatever metrics and parameters are
    /// called. A plain name is a parameter, or the metric that is maximised; nothing is the gain.
    fn read(asked: &str, parameters: &[Parameter], view: &CostView) -> Result<Self> {
        let named = |name: &str| parameters.iter().position(|parameter| parameter.name == name);
        match asked {
            "" | "gain" => return Ok(Self::Gain),
            "cost" => return Ok(Self::Cost),
            _ => {}
        }
        match asked.strip_prefix("config.").and_then(named).or_else(|| named(asked)) {
            Some(index) => Ok(Self::Parameter(index)),
            None if asked == view.name() => Ok(Self::Cost),
            None => Err(Error::invalid(
                "show",
                format!("there is no map of {asked:?}; use gain, cost, or config.NAME of a parameter"),
            )),
        }
    }
}

pub(in super::super) async fn map(visitor: &Visitor<'_>, id: &str, query: &Query) -> Result<String> {
    let (head, study) = head(visitor, id, "map").await?;
    query.only(&["x", "y", "show"])?;
    let id = super::id(&study.name);
    let spec = visitor.tuning.get_study(id).await?.spec;
    let indicators = spec.indicators.indicators();
    let parameters = spec.space.parameters();
    let mut states = Vec::new();
    for number in 1..=head.states.min(STATES) {
        states.extend(read_state(visitor, id, number).await?);
    }
    let (first, second) = widest(indicators, &states);
    let named =
        |axis: &str| asked_axis(query, axis, indicators.iter().map(|indicator| indicator.name.as_str()));
    let (x, y) = (named("x")?.unwrap_or(first), named("y")?.unwrap_or(second));
    let view = &head.view;
    let shown = Shown::read(&query.text("show"), parameters, view)?;
    let label = |of: &StateStands| match shown {
        Shown::Parameter(index) => {
            let parameter = &parameters[index];
            let values = &of.best.as_ref()?.configuration.as_ref()?.values;
            let value = values.get(&parameter.name)?;
            let words = format!("{}={}", parameter.name, super::value(value));
            let value = treewright_proto::convert::value_from_wire("value", value.clone()).ok()?;
            Some((stats::place(parameter, &value)?, words))
        }
        Shown::Cost => of.standing.map(|standing| {
            (standing.cost, format!("{} {}", view.title(), figure(view.value(standing.cost))))
        }),
        Shown::Gain => of
            .standing?
            .gain
            .map(|gain| (-gain.share, format!("{} {} the default", gain.by(view), view.better_side()))),
    };
    let at =
        |of: &StateStands, index: usize| indicators.get(index).map_or(0.5, |one| position(one, &of.trial));
    let places: Vec<Place> = states
        .iter()
        .filter_map(|of| {
            let (rank, words) = label(of)?;
            let link = format!("/studies/{id}?state={}#curve", of.state);
            Some(Place { state: of.state, x: at(of, x), y: at(of, y), rank, words, link })
        })
        .collect();
    let ends = match (shown, view.is_maximised()) {
        (Shown::Parameter(_), _) => ["the lowest fifth", "the highest"],
        (Shown::Gain, _) | (Shown::Cost, true) => ["the largest fifth", "the smallest"],
        (Shown::Cost, false) => ["the smallest fifth", "the largest"],
    };
    let picture = match (indicators.get(x), indicators.get(y)) {
        (Some(x), Some(y)) => charts::map(&axis(x), &axis(y), ends, &places),
        _ => String::new(),
    };
    let name = |index: usize| indicators.get(index).map(|one| one.name.clone()).unwrap_or_default();
    let page = Page {
        frame: visitor.frame,
        is_cut: head.states > STATES,
        indicators: indicators.iter().map(|indicator| indicator.name.clone()).collect(),
        parameters: parameters
            .iter()
            .enumerate()
            .map(|(index, parameter)| (parameter.name.clone(), shown == Shown::Parameter(index)))
            .collect(),
        x: name(x),
        y: name(y),
        is_gain: shown == Shown::Gain,
        is_cost: shown == Shown::Cost,
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

#[cfg(test)]
mod tests {
    use treewright_core::objective::{Objective, ObjectiveTerm};
    use treewright_core::space::Space;

    use super::*;

    #[test]
    fn each_map_can_be_asked_for_whatever_metrics_and_parameters_are_called() {
        let maximising = |metric: &str| {
            let term = ObjectiveTerm { metric: metric.into(), weight: 1.0 };
            let objective = Objective::new(vec![term]).expect("valid").with_maximised(vec![metric.into()]);
            objective.expect("a term").view()
        };
        let space = Space::builder().integer("leaf", 1..=8).default(1).integer("cost", 1..=8).default(1);
        let space = space.integer("gain", 1..=8).default(1).build().expect("a space");
        let read = |asked: &str, view: &CostView| Shown::read(asked, space.parameters(), view);
        for view in [CostView::default(), maximising("fps"), maximising("gain"), maximising("leaf")] {
            assert_eq!([read("", &view), read("gain", &view)], [Ok(Shown::Gain), Ok(Shown::Gain)]);
            assert_eq!(read("cost", &view), Ok(Shown::Cost), "{view:?}");
            for (index, name) in ["leaf", "cost", "gain"].into_iter().enumerate() {
                assert_eq!(read(&format!("config.{name}"), &view), Ok(Shown::Parameter(index)), "{view:?}");
            }
            assert_eq!(read("leaf", &view), Ok(Shown::Parameter(0)));
            let error = read("nonsense", &view).expect_err("there is no such map").to_string();
            assert!(error.contains("nonsense") && error.contains("config.NAME"), "{error}");
        }
        assert_eq!(read("fps", &maximising("fps")), Ok(Shown::Cost));
    }
}
