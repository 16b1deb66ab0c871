//! The predictors of the core, taught the searches of some cameras and asked about others.
//!
//! Each predictor is taught every iteration and answers for itself. The RBF model has three further entrants:
//! two choose among the last iterations of the searches, as the paper does (section 7.1.2), taught all or
//! those alone, one among everything. The last entrant is the service as it answers: a study with the default
//! policy.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use treewright_client::{Configuration, Indicator, Outcome};
use treewright_core::ids::{MachineId, StateId};
use treewright_core::objective::{Objective as StudyObjective, ObjectiveTerm};
use treewright_core::policy::{Policy, PredictorMethod};
use treewright_core::predict::{Lesson, METHODS, Predictors, Query, StateIndex};
use treewright_core::results::{KnownState, ResultTable};
use treewright_core::study::{STATE_TOLERANCE_DEFAULT, StudySpec};
use treewright_core::trial::{Trial, TrialState};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::{
    configuration::Configuration as Checked, indicator::IndicatorSchema, machines::Machines, search::Verdict,
    space::Space,
};
use treewright_render_cli::error::{CliError, Result};
use treewright_renderer::{tuning::objective::Objective, tuning::workload};

use super::folds::Fold;
use super::record::{Place, Search, cost};

/// The entrant that is taught the last iteration of each search alone.
pub(crate) const RBF_LAST: &str = "rbf_greedy_gq, last iteration";
/// The entrant that is taught everything, and chooses among the last iterations.
pub(crate) const RBF_AMONG_LAST: &str = "rbf_greedy_gq, among last iterations";
/// The entrant that is taught everything, and chooses among all that could be run.
pub(crate) const RBF_AMONG_ALL: &str = "rbf_greedy_gq, among all tried";
/// The entrant that is the service with its default policy.
pub(crate) const SERVICE: &str = "service";
/// Of whatever predictors draw at random.
const SEED: u64 = 1;
/// The name of the one cost in what predictors are taught.
const COST: &str = "cost";

/// Everybody who answers, the paper's two first.
pub(crate) fn entrants() -> Vec<String> {
    let paper = [PredictorMethod::NearestNeighbour, PredictorMethod::RbfGreedyGq];
    let others = METHODS.iter().filter(|method| !paper.contains(method));
    let mut all: Vec<String> = paper.iter().map(|method| method.name().to_owned()).collect();
    all.extend([RBF_LAST, RBF_AMONG_LAST, RBF_AMONG_ALL].map(str::to_owned));
    all.extend(others.map(|method| method.name().to_owned()));
    all.extend([PredictorMethod::Auto.name().to_owned(), SERVICE.to_owned()]);
    all
}

/// The answer of each entrant at each camera that examines.
pub(crate) type Answers = BTreeMap<(Place, String), Configuration>;

/// Searches of one objective as predictors see them.
pub(crate) struct School<'a> {
    space: &'a Space,
    schema: IndicatorSchema,
    objective: Objective,
    searches: BTreeMap<&'a Place, &'a Search>,
    /// A completed trial of no matter what, whose configuration and result are replaced.
    template: Trial,
}

impl<'a> School<'a> {
    pub(crate) fn new(
        space: &'a Space,
        objective: Objective,
        searches: impl Iterator<Item = &'a Search>,
    ) -> Result<Self> {
        let schema = workload::schema()
            .map(|(name, min, max, scale)| Indicator { name: name.to_owned(), min, max, scale })
            .collect();
        let schema = IndicatorSchema::new(schema).map_err(|error| CliError::Failed(error.to_string()))?;
        let searches: BTreeMap<&Place, &Search> = searches.map(|search| (&search.place, search)).collect();
        let template = template(space, &schema, &searches)?;
        Ok(Self { space, schema, objective, searches, template })
    }

    fn normalised(&self, search: &Search) -> Result<Vec<f64>> {
        self.schema.normalise(&search.state).map_err(|error| CliError::Failed(error.to_string()))
    }

    /// The verdict of every iteration, with its configuration.
    fn lessons(&self, search: &Search) -> Result<Vec<(Checked, Verdict)>> {
        let mut lessons = Vec::with_capacity(search.iterations.len());
        for iteration in &search.iterations {
            let verdict = match (&iteration.outcome, &iteration.times) {
                (Outcome::Ok, Some(times)) => Some(Verdict::Cost(cost(self.objective, times))),
                (Outcome::Infeasible { .. }, _) => Some(Verdict::Infeasible),
                _ => None,
            };
            let configuration = self
                .space
                .configuration(iteration.configuration.as_raw().clone())
                .map_err(|error| CliError::Failed(format!("the record is of another space: {error}")))?;
            lessons.extend(verdict.map(|verdict| (configuration, verdict)));
        }
        Ok(lessons)
    }

    /// All entrants' answers at the cameras of a fold that examine.
    pub(crate) fn answers(&self, fold: &Fold) -> Result<Answers> {
        let mut answers = Answers::new();
        let all = Class::taught(self, fold, false)?;
        let last = Class::taught(self, fold, true)?;
        let service = Service::taught(self, fold)?;
        for place in &fold.examine {
            let Some(search) = self.searches.get(place) else { continue };
            let state = self.normalised(search)?;
            for name in entrants() {
                let answer = match name.as_str() {
                    SERVICE => Some(service.answer(search)?),
                    RBF_LAST => last.answer(self.space, &state, PredictorMethod::RbfGreedyGq),
                    RBF_AMONG_LAST => all.least(self.space, &state, &all.last),
                    RBF_AMONG_ALL => all.least(self.space, &state, &all.tried),
                    _ => all.answer(self.space, &state, method(&name)),
                };
                if let Some(answer) = answer {
                    answers.insert((place.clone(), name), answer);
                }
            }
        }
        Ok(answers)
    }
}

fn method(name: &str) -> PredictorMethod {
    METHODS.iter().copied().find(|method| method.name() == name).unwrap_or(PredictorMethod::Auto)
}

/// The states that were taught, as predictors look them up.
struct Known {
    states: Vec<KnownState>,
    index: StateIndex,
    machines: Machines,
}

impl Known {
    fn query<'a>(&'a self, space: &'a Space, state: &'a [f64]) -> Query<'a> {
        Query {
            state,
            here: None,
            known: &self.states,
            state_index: &self.index,
            space,
            machines: &self.machines,
            machine: MachineId(0),
            rival: None,
        }
    }
}

/// Predictors that were taught the cameras of a fold.
struct Class {
    predictors: Predictors,
    known: Known,
    /// The last configuration of each search, and all that any of them ran to its end.
    last: Vec<Checked>,
    tried: Vec<Checked>,
}

impl Class {
    fn taught(school: &School<'_>, fold: &Fold, only_last: bool) -> Result<Self> {
        let indicators = school.schema.indicators().len();
        let mut machines = Machines::default();
        machines.note_founder(None);
        let mut class = Self {
            predictors: Predictors::new(PredictorMethod::Auto, school.space, indicators, SEED, &[]),
            known: Known { states: Vec::new(), index: StateIndex::new(indicators), machines },
            last: Vec::new(),
            tried: Vec::new(),
        };
        for place in &fold.teach {
            let Some(search) = school.searches.get(place) else { continue };
            let mut lessons = school.lessons(search)?;
            if only_last {
                lessons.drain(..lessons.len().saturating_sub(1));
            }
            class.teach(school, &school.normalised(search)?, &lessons);
        }
        class.predictors.apply_all(school.space);
        Ok(class)
    }

    /// Teaches one search. It is tested first by what is known before, as in the service.
    fn teach(&mut self, school: &School<'_>, state: &[f64], lessons: &[(Checked, Verdict)]) {
        let default = school.space.default_configuration();
        let ran = |(configuration, verdict): &(Checked, Verdict)| {
            matches!(verdict, Verdict::Cost(_)).then(|| configuration.clone())
        };
        self.tried.extend(lessons.iter().filter_map(ran));
        self.last.extend(lessons.iter().rev().find_map(ran));
        let (mut results, mut default_cost) = (ResultTable::default(), None);
        for (configuration, verdict) in lessons {
            if let Verdict::Cost(cost) = verdict {
                self.predictors.test(&self.known.query(school.space, state), configuration, *cost);
                if *configuration == default {
                    default_cost = Some(*cost);
                }
            }
            results.learn(&school.trial(configuration, *verdict), &default);
            self.predictors.learn(&Lesson {
                state,
                configuration,
                point: &school.space.encode(configuration),
                verdict: *verdict,
                default_cost,
                machine: 0,
            });
        }
        let known = KnownState {
            id: StateId(self.known.states.len() as u64 + 1),
            anchor: state.to_vec(),
            machine: MachineId(0),
            explored: true,
            results: Arc::new(results),
        };
        self.known.index.note(&known);
        self.known.states.push(known);
        self.predictors.apply_all(school.space);
    }

    fn answer(&self, space: &Space, state: &[f64], method: PredictorMethod) -> Option<Configuration> {
        let (answer, _) = self.predictors.predict(method, &self.known.query(space, state))?;
        Some(answer.configuration.to_raw().into())
    }

    /// The configuration from which the RBF model expects the least cost, the first among equals.
    fn least(&self, space: &Space, state: &[f64], of: &[Checked]) -> Option<Configuration> {
        let (query, method) = (self.known.query(space, state), PredictorMethod::RbfGreedyGq);
        let expected = |one| Some((one, self.predictors.estimate(method, &query, one)?.cost));
        let (best, _) = of.iter().filter_map(expected).min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(best.to_raw().into())
    }
}

/// The service with its default policy, to which a client brought the searches of a fold.
struct Service(Tuner);

impl Service {
    fn taught(school: &School<'_>, fold: &Fold) -> Result<Self> {
        let mut tuner = tuner(school.space, &school.schema, STATE_TOLERANCE_DEFAULT)?;
        let mut now_ms = 0;
        for place in &fold.teach {
            let Some(search) = school.searches.get(place) else { continue };
            let ask = ask(search);
            for (configuration, verdict) in school.lessons(search)? {
                let (measured, outcome) = told(verdict);
                now_ms += 1;
                let brought = tuner.suggest_wanted(&ask, configuration.to_raw(), None, now_ms);
                let (open, _) = brought.map_err(not_judged)?;
                let (_, _) = tuner.report(&open, measured, outcome, now_ms).map_err(not_judged)?;
            }
        }
        Ok(Self(tuner))
    }

    fn answer(&self, search: &Search) -> Result<Configuration> {
        let prediction = self.0.predict(&search.state, None).map_err(not_judged)?;
        Ok(prediction.configuration.to_raw().into())
    }
}

impl School<'_> {
    fn trial(&self, configuration: &Checked, verdict: Verdict) -> Trial {
        let (measurements, outcome) = told(verdict);
        Trial {
            configuration: configuration.clone(),
            state: TrialState::Completed,
            cost: measurements.get(COST).copied(),
            measurements,
            outcome: Some(outcome),
            ..self.template.clone()
        }
    }
}

/// The report of a client for a verdict.
fn told(verdict: Verdict) -> (BTreeMap<String, f64>, Outcome) {
    match verdict {
        Verdict::Cost(cost) => (BTreeMap::from([(COST.to_owned(), cost)]), Outcome::Ok),
        _ => (BTreeMap::new(), Outcome::infeasible("recorded")),
    }
}

fn not_judged(error: impl std::fmt::Display) -> CliError {
    CliError::Failed(format!("the record cannot be judged: {error}"))
}

fn ask(search: &Search) -> Ask {
    Ask { client_id: "evaluation".to_owned(), indicators: search.state.clone(), ..Ask::default() }
}

/// A tuner with the default policy that knows nothing yet.
fn tuner(space: &Space, schema: &IndicatorSchema, state_tolerance: f64) -> Result<Tuner> {
    let term = ObjectiveTerm { metric: COST.to_owned(), weight: 1.0 };
    let spec = StudySpec {
        display_name: "evaluation".to_owned(),
        note: String::new(),
        tags: BTreeSet::new(),
        space: space.clone(),
        indicators: schema.clone(),
        objective: StudyObjective::new(vec![term]).map_err(not_judged)?,
        state_tolerance,
        policy: Policy::default(),
        seed: SEED,
    };
    Tuner::new(Arc::new(spec)).map_err(not_judged)
}

fn template(space: &Space, schema: &IndicatorSchema, searches: &BTreeMap<&Place, &Search>) -> Result<Trial> {
    let first = searches.values().next().ok_or_else(|| not_judged("it holds no search"))?;
    let mut tuner = tuner(space, schema, 0.0)?;
    let (open, _) = tuner.suggest(&ask(first), 0).map_err(not_judged)?;
    let (measured, outcome) = told(Verdict::Cost(1.0));
    let (trial, _) = tuner.report(&open, measured, outcome, 1).map_err(not_judged)?;
    Ok(trial)
}

#[cfg(test)]
mod tests {
    use treewright_renderer::space::{TuningSpace, parse};

    use super::super::{folds::Split, testing};
    use super::*;

    /// A state in the middle of every indicator's range, but for the triangles.
    fn state(triangles: f64) -> BTreeMap<String, f64> {
        let middle = |(name, min, max, _): (&str, f64, f64, _)| {
            (name.to_owned(), if name == "triangle_count" { triangles } else { (min + max) / 2.0 })
        };
        workload::schema().map(middle).collect()
    }

    #[test]
    fn last_iterations_teach_alone_and_the_service_answers_beside_the_predictors() {
        let whole = TuningSpace::paper();
        let of = |text: &str| whole.complete(&parse(text).expect("it is one")).expect("it is complete");
        let (default, best, last) = (whole.default_configuration(), of("quality=3"), of("quality=1"));
        let tried: Vec<_> =
            [(&default, 100.0), (&best, 50.0)].repeat(12).into_iter().chain([(&last, 70.0)]).collect();
        let tried: Vec<_> = tried.into_iter().map(|(one, ms)| (one.clone(), Some(ms))).collect();
        let searches = [("hall", 1e5), ("annex", 1.001e5)]
            .map(|(scene, triangles)| Search { state: state(triangles), ..testing::search(scene, &tried) });
        let school = School::new(whole.space(), Objective::Render, searches.iter());
        let school = school.expect("it is one");
        let [hall, annex] = ["hall", "annex"].map(testing::place);
        let examined = |teach: Vec<Place>| {
            let fold = Fold { split: Split::Scene, teach, examine: vec![annex.clone()] };
            school.answers(&fold).expect("everybody answers")
        };
        let taught = examined(vec![hall]);
        let of = |name: &str| taught.get(&(annex.clone(), name.to_owned()));
        assert_eq!(of("nearest_neighbour"), Some(&best));
        assert_eq!(of(RBF_LAST), Some(&last));
        assert_ne!(of("rbf_greedy_gq"), Some(&last), "it was taught all of them");
        assert_eq!(of(RBF_AMONG_LAST), Some(&last), "the one search has one last iteration");
        assert_eq!(of(RBF_AMONG_ALL), of("rbf_greedy_gq"), "three configurations are all kept as candidates");
        // It recognises the state, and its own measurements prove the best.
        assert_eq!(of(SERVICE), Some(&best));
        // Where nothing is known the service still has an answer, as its users do.
        let untaught = examined(Vec::new());
        assert_eq!(untaught.get(&(annex.clone(), SERVICE.to_owned())), Some(&default));
        assert_eq!(untaught.get(&(annex.clone(), "nearest_neighbour".to_owned())), None);
    }
}
