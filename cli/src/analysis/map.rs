//! Two parameters against a measurement: the median of each pair of values, such as both leaf sizes (paper,
//! Figure 5).

use std::collections::BTreeMap;

use serde::Serialize;

use super::table::{Column, Measured, Table, quantile, sorted};

/// Most cells along an axis.
const CELLS: usize = 16;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Map {
    pub(crate) metric: String,
    /// The study maximises it.
    pub(crate) higher_is_better: bool,
    /// Across, then up.
    pub(crate) parameters: [String; 2],
    /// Lower ends of the cells along both axes; the last number is the highest value.
    pub(crate) edges: [Vec<f64>; 2],
    pub(crate) cells: Vec<Cell>,
}

/// Trials whose values lie in one cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Cell {
    /// Across and up, from 0.
    pub(crate) at: [usize; 2],
    pub(crate) trials: usize,
    /// Median of the measurement relative to its state.
    pub(crate) relative: f64,
}

/// The map of a pair; `None` where one of both does not vary.
pub(super) fn of(table: &Table, pair: &(String, String), metric: &Measured) -> Option<Map> {
    let columns = [table.parameter(&pair.0)?, table.parameter(&pair.1)?];
    if !columns.iter().all(|column| column.varies() && column.ordered) {
        return None;
    }
    let edges = columns.map(edges);
    let mut cells: BTreeMap<[usize; 2], Vec<f64>> = BTreeMap::new();
    for (trial, relative) in metric.relative.iter().enumerate() {
        if let (Some(x), Some(y), Some(relative)) =
            (columns[0].values[trial], columns[1].values[trial], relative)
        {
            cells.entry([cell(&edges[0], x), cell(&edges[1], y)]).or_default().push(*relative);
        }
    }
    let cells = cells.into_iter().map(|(at, values)| {
        let values = sorted(values);
        Cell { at, trials: values.len(), relative: quantile(&values, 0.5) }
    });
    let parameters = columns.map(|column| column.name.clone());
    let (name, higher_is_better) = (metric.name.clone(), metric.higher_is_better);
    Some(Map { metric: name, higher_is_better, parameters, cells: cells.collect(), edges })
}

fn edges(column: &Column) -> Vec<f64> {
    let mut values = sorted(column.values.iter().flatten().copied());
    values.dedup();
    let (low, high) = (values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(1.0));
    if values.len() <= CELLS {
        values.push(high);
        return values;
    }
    (0..=CELLS).map(|edge| low + (high - low) * edge as f64 / CELLS as f64).collect()
}

fn cell(edges: &[f64], value: f64) -> usize {
    let last = edges.len() - 2;
    edges[1..edges.len() - 1].iter().filter(|edge| value >= **edge).count().min(last)
}
