//! A predictor that knows states and configurations together, and can look for new configurations.
//!
//! Where every input is met once, no search inside one state gets anywhere, and the best known configuration
//! of a neighbour is the best of very few. What helps is a model of cost over indicators and parameters
//! together: a contextual Gaussian process (Krause and Ong, "Contextual Gaussian process bandit optimization",
//! NIPS 2011). What was measured stays in the states' tables; a question fits a small process (`field`) to the
//! measurements of the states nearest to it (local fits after Gramacy and Apley, "Local Gaussian process
//! approximation for large computer experiments", 2015), so that an answer costs the same after a million
//! trials. Lessons only move lengths and noise (`hyper`), one step each while there are few.

mod climb;
mod field;
mod hyper;
mod values;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::knowledge::{KnownState, Record};
use crate::predict::nearest::neighbours;
use crate::predict::{Answer, Estimate, Lesson, Predictor, Query, draw_in};
use crate::randomness::{Purpose, stream};
use crate::search::Verdict;
use crate::search::layout::{Layout, Metric};
use crate::space::Space;
use climb::{Climber, Place};
use field::{Field, Rows};
use hyper::Hyper;
use values::Values;

/// Most measurements that a process is fitted to.
const ROWS_MAX: usize = 96;
/// Most measurements of the nearest state among them; each further state gives half as many, but
const QUOTA_FIRST: usize = 48;
/// at least so many.
const QUOTA_LEAST: usize = 8;
/// Most lessons that lengths are learnt from: the latest.
const LESSONS_MAX: usize = 64;
/// What a measurement of the machine itself, of its group and of the fleet is worth: machines differ.
const TRUST: [f64; 3] = [1.0, 0.5, 0.25];
/// Lessons that are each worth a step; later ones share.
const LESSONS_EAGER: u64 = 96;
const LESSONS_SHARE: u64 = 32;
/// No process is fitted to less.
const ROWS_MIN: usize = 2;
/// Steps that a lesson is worth.
const STEPS: usize = 2;
/// Deviations that are taken off what is expected, when a new configuration is looked for; when an answer is
/// given where nobody searches, so that answers themselves must learn; and where states near by were searched,
/// so that what was measured there is preferred to what was not. On the problems of `examples/contextual` the
/// first two gave a mean regret of 0.27, 0 in place of 0.5 one of 0.30, and -0.5 one of 0.39.
const EXPLORE: f64 = 1.0;
const EXPLOIT: f64 = 0.5;
const EXPLOIT_SEARCHED: f64 = -0.5;

/// A measurement that lengths are learnt from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Example {
    features: Vec<f64>,
    cost: f64,
}

/// The predictor. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contextual {
    #[serde(skip)]
    layout: Layout,
    #[serde(skip)]
    metrics: Vec<Metric>,
    indicators: usize,
    seed: u64,
    hyper: Hyper,
    /// The latest lessons, in a ring.
    examples: Vec<Example>,
    lessons: u64,
}

/// What is measured near a state.
struct Local<'a> {
    rows: Rows,
    values: Vec<f64>,
    transform: Values,
    records: Vec<&'a Record>,
    /// How many of them come from states that were searched.
    searched: usize,
}

impl Contextual {
    /// A predictor that has seen nothing yet, for studies of `space` and so many indicators.
    pub fn new(space: &Space, indicators: usize, seed: u64) -> Self {
        let layout = Layout::of(space);
        let mut metrics = vec![Metric::Ordered; indicators];
        metrics.extend(layout.metrics());
        Contextual {
            hyper: Hyper::new(metrics.len()),
            layout,
            metrics,
            indicators,
            seed,
            examples: Vec::new(),
            lessons: 0,
        }
    }

    /// Makes what was read from a checkpoint whole.
    pub(super) fn settle(&mut self, space: &Space) {
        let Contextual { layout, metrics, .. } = Contextual::new(space, self.indicators, self.seed);
        (self.layout, self.metrics) = (layout, metrics);
    }

    /// What the process sees of a point of the unit cube.
    fn features(&self, point: &[f64]) -> Vec<f64> {
        let mut x = point.to_vec();
        let active = self.layout.canonical(&mut x);
        self.layout.features(&x, &active)
    }

    /// The measurements that bear on a state: most of the nearest states', the best of each first.
    fn local<'a>(&self, query: &Query<'a>) -> Option<Local<'a>> {
        let found = query.nearest(ROWS_MAX, false, |state| state.knowledge.best().is_some());
        let mut rows = Rows::new(self.metrics.clone());
        let (mut records, mut costs, mut quota, mut searched) = (Vec::new(), Vec::new(), QUOTA_FIRST, 0);
        for state in found.iter().filter_map(|found| query.known.get(found.name as usize)) {
            let taken = quota.min(ROWS_MAX - rows.len());
            let anchor: Vec<f64> = state.anchor.iter().map(|&x| draw_in(x)).collect();
            let trust = TRUST[query.fleet.level(query.machine, state.machine) as usize];
            for record in selection(state, taken) {
                rows.push(
                    &anchor,
                    &self.features(&query.space.encode(&record.configuration)),
                    trust * record.measurements as f64,
                );
                costs.push(query.translate(state, record.mean_cost));
                records.push(record);
                searched += usize::from(state.explored);
            }
            quota = (quota / 2).max(QUOTA_LEAST);
            if rows.len() >= ROWS_MAX {
                break;
            }
        }
        let transform = Values::of(&costs)?;
        let values = costs.iter().map(|&cost| transform.see(cost)).collect();
        (rows.len() >= ROWS_MIN).then_some(Local { rows, values, transform, records, searched })
    }

    fn towards(&self, field: &Field<'_>, state: &[f64]) -> Vec<f64> {
        let state: Vec<f64> = state.iter().map(|&x| draw_in(x)).collect();
        field.towards(&state)
    }

    fn choose(
        &self,
        query: &Query<'_>,
        optimism: impl Fn(&Local<'_>) -> f64,
        random: &mut ChaCha8Rng,
    ) -> Option<Answer> {
        let local = self.local(query)?;
        let optimism = optimism(&local);
        let field = Field::fit(&local.rows, &local.values, &self.hyper)?;
        let towards = self.towards(&field, query.state);
        let place = Place { field: &field, layout: &self.layout, towards: &towards, optimism };
        let known = local.records.iter().map(|record| query.space.encode(&record.configuration));
        let excludes = |x: &[f64]| query.here.is_some() && query.excludes(&query.space.decode(x));
        let Climber { x, belief, .. } = place.best(known, random, excludes)?;
        let variance = belief.deviation * belief.deviation + field.noise();
        Some(Answer {
            configuration: query.space.decode(&x),
            expected: estimate(&local.transform, belief.mean, variance),
            neighbours: neighbours(query),
        })
    }
}

/// A belief in the objective's units. The deviation is that of a single measurement.
fn estimate(transform: &Values, mean: f64, variance: f64) -> Estimate {
    let cost = transform.cost(mean);
    let above = transform.cost(mean + variance.sqrt());
    Estimate::new(cost, above - cost)
}

/// At most `count` of a state's records: the better half of them the best, the others evenly from the rest.
fn selection(state: &KnownState, count: usize) -> Vec<&Record> {
    let all: Vec<&Record> = state.knowledge.ranked().collect();
    if all.len() <= count {
        return all;
    }
    let best = count.div_ceil(2);
    let rest = count - best;
    let step = |index: usize| best + (index * (all.len() - best)) / rest.max(1);
    all[..best].iter().copied().chain((0..rest).map(|index| all[step(index)])).collect()
}

impl Predictor for Contextual {
    fn learn(&mut self, lesson: &Lesson<'_>) {
        let Verdict::Cost(cost) = lesson.verdict else {
            return;
        };
        let mut features: Vec<f64> = lesson.state.iter().map(|&x| draw_in(x)).collect();
        features.extend(self.features(lesson.point));
        let example = Example { features, cost };
        let place = (self.lessons % LESSONS_MAX as u64) as usize;
        match self.examples.get_mut(place) {
            Some(old) => *old = example,
            None => self.examples.push(example),
        }
        self.lessons += 1;
        let due = self.lessons <= LESSONS_EAGER || self.lessons.is_multiple_of(LESSONS_SHARE);
        if !due || self.examples.len() < 4 {
            return;
        }
        let costs: Vec<f64> = self.examples.iter().map(|example| example.cost).collect();
        let Some(transform) = Values::of(&costs) else {
            return;
        };
        let mut rows = Rows::new(self.metrics.clone());
        for example in &self.examples {
            let (state, configuration) = example.features.split_at(self.indicators);
            rows.push(state, configuration, 1.0);
        }
        let values: Vec<f64> = costs.iter().map(|&cost| transform.see(cost)).collect();
        (0..STEPS).for_each(|_| self.hyper.climb(&rows, &values));
    }

    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate> {
        let local = self.local(query)?;
        let field = Field::fit(&local.rows, &local.values, &self.hyper)?;
        let towards = self.towards(&field, query.state);
        let belief = field.at(&towards, &self.features(&query.space.encode(configuration)));
        let variance = belief.deviation * belief.deviation + field.noise();
        Some(estimate(&local.transform, belief.mean, variance))
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let mut random = stream(self.seed, Purpose::Contextual, 0, self.lessons);
        let optimism = |local: &Local<'_>| {
            if 2 * local.searched > local.records.len() { EXPLOIT_SEARCHED } else { EXPLOIT }
        };
        self.choose(query, optimism, &mut random)
    }

    fn propose(&self, query: &Query<'_>, number: u64) -> Option<Answer> {
        let mut random = stream(self.seed, Purpose::Contextual, 1, number);
        self.choose(query, |_| EXPLORE, &mut random)
    }
}
