//! The predictors of the core, taught the searches of some cameras and asked about others.
//!
//! Nothing of the service's policy takes part: each predictor is taught every iteration and answers for
//! itself. One further entrant is taught only the last iteration of each search, as the paper has it for its
//! figures (section 7.1.2).

use std::collections::BTreeMap;
use std::sync::Arc;

use treewright_client::{Configuration, Indicator, Outcome};
use treewright_core::configuration::Configuration as Checked;
use treewright_core::ids::{MachineId, StateId};
use treewright_core::indicator::IndicatorSchema;
use treewright_core::machines::{Machines, Origin};
use treewright_core::objective::{Objective as StudyObjective, ObjectiveTerm};
use treewright_core::policy::{Policy, PredictorMethod};
use treewright_core::predict::{Lesson, METHODS, Predictors, Query, StateIndex};
use treewright_core::results::{KnownState, ResultTable};
use treewright_core::search::Verdict;
use treewright_core::space::Space;
use treewright_core::study::StudySpec;
use treewright_core::trial::{Trial, TrialState};
use treewright_core::tuner::{Ask, Tuner};
use treewright_render_cli::error::CliError;
use treewright_renderer::tuning::objective::Objective;
use treewright_renderer::tuning::workload;

use super::folds::Fold;
use super::record::{Clock, Place, Search};

/// The entrant that is taught the last iteration of each search alone.
pub(crate) const RBF_LAST: &str = "rbf_greedy_gq, last iteration";

/// Of whatever predictors draw at random.
const SEED: u64 = 1;

/// The name of the one cost in what predictors are taught.
const COST: &str = "cost";

/// Everybody who answers, the paper's two first.
pub(crate) fn entrants() -> Vec<String> {
    let paper = [PredictorMethod::NearestNeighbour, PredictorMethod::RbfGreedyGq];
    let others = METHODS.iter().filter(|method| !paper.contains(method));
    let mut all: Vec<String> = paper.iter().map(|method| method.name().to_owned()).collect();
    all.push(RBF_LAST.to_owned());
    all.extend(others.map(|method| method.name().to_owned()));
    all.push(PredictorMethod::Auto.name().to_owned());
    all
}

/// What each entrant answers at each camera that examines.
pub(crate) type Answers = BTreeMap<(Place, String), Configuration>;

/// Searches of one objective as predictors see them.
pub(crate) struct School<'a> {
    space: &'a Space,
    schema: IndicatorSchema,
    objective: Objective,
    clock: Clock,
    searches: BTreeMap<&'a Place, &'a Search>,
    /// A completed trial of no matter what, whose configuration and result are replaced.
    template: Trial,
}

impl<'a> School<'a> {
    /// Takes the searches of an objective, one a place.
    pub(crate) fn new(
        space: &'a Space,
        objective: Objective,
        clock: Clock,
        searches: impl Iterator<Item = &'a Search>,
    ) -> Result<Self, CliError> {
        let schema = workload::schema()
            .map(|(name, min, max, scale)| Indicator { name: name.to_owned(), min, max, scale })
            .collect();
        let schema = IndicatorSchema::new(schema).map_err(|error| CliError::Failed(error.to_string()))?;
        let searches: BTreeMap<&Place, &Search> = searches.map(|search| (&search.place, search)).collect();
        let template = template(space, &schema, &searches)?;
        Ok(Self { space, schema, objective, clock, searches, template })
    }

    fn normalised(&self, search: &Search) -> Result<Vec<f64>, CliError> {
        self.schema.normalise(&search.state).map_err(|error| CliError::Failed(error.to_string()))
    }

    /// The verdict of every iteration, with its configuration.
    fn lessons(&self, search: &Search) -> Result<Vec<(Checked, Verdict)>, CliError> {
        let mut lessons = Vec::with_capacity(search.iterations.len());
        for iteration in &search.iterations {
            let verdict = match (&iteration.outcome, &iteration.times) {
                (Outcome::Ok, Some(times)) => self.clock.cost(self.objective, times).map(Verdict::Cost),
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

    /// What everybody answers at the cameras of a fold that examine.
    pub(crate) fn answers(&self, fold: &Fold) -> Result<Answers, CliError> {
        let mut answers = Answers::new();
        let all = Class::taught(self, fold, false)?;
        let last = Class::taught(self, fold, true)?;
        for place in &fold.examine {
            let Some(search) = self.searches.get(place) else { continue };
            let state = self.normalised(search)?;
            for name in entrants() {
                let (class, method) = match name.as_str() {
                    RBF_LAST => (&last, PredictorMethod::RbfGreedyGq),
                    _ => (&all, method(&name)),
                };
                if let Some(answer) = class.answer(self.space, &state, method) {
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
}

impl Class {
    fn taught(school: &School<'_>, fold: &Fold, only_last: bool) -> Result<Self, CliError> {
        let indicators = school.schema.indicators().len();
        let mut machines = Machines::default();
        machines.note_founder(None);
        let mut class = Self {
            predictors: Predictors::new(PredictorMethod::Auto, school.space, indicators, SEED, &[]),
            known: Known { states: Vec::new(), index: StateIndex::new(indicators), machines },
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
                origin: Origin { group: 0, node: 0 },
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
}

impl School<'_> {
    fn trial(&self, configuration: &Checked, verdict: Verdict) -> Trial {
        let (outcome, cost) = match verdict {
            Verdict::Cost(cost) => (Outcome::Ok, Some(cost)),
            _ => (Outcome::infeasible("recorded"), None),
        };
        Trial {
            configuration: configuration.clone(),
            state: TrialState::Completed,
            measurements: cost.iter().map(|cost| (COST.to_owned(), *cost)).collect(),
            cost,
            outcome: Some(outcome),
            ..self.template.clone()
        }
    }
}

/// A trial as the core makes one.
fn template(
    space: &Space,
    schema: &IndicatorSchema,
    searches: &BTreeMap<&Place, &Search>,
) -> Result<Trial, CliError> {
    let failed = |error: String| CliError::Failed(format!("the record cannot be judged: {error}"));
    let first = searches.values().next().ok_or_else(|| failed("it holds no search".to_owned()))?;
    let term = ObjectiveTerm { metric: COST.to_owned(), weight: 1.0 };
    let spec = StudySpec {
        display_name: "evaluation".to_owned(),
        space: space.clone(),
        indicators: schema.clone(),
        objective: StudyObjective::new(vec![term]).map_err(|error| failed(error.to_string()))?,
        state_tolerance: 0.0,
        policy: Policy::default(),
        seed: SEED,
    };
    let mut tuner = Tuner::new(Arc::new(spec)).map_err(|error| failed(error.to_string()))?;
    let ask = Ask { client_id: "evaluation".to_owned(), indicators: first.state.clone(), ..Ask::default() };
    let (open, _) = tuner.suggest(&ask, 0).map_err(|error| failed(error.to_string()))?;
    let measured = BTreeMap::from([(COST.to_owned(), 1.0)]);
    let (trial, _) =
        tuner.report(&open, measured, Outcome::Ok, 1).map_err(|error| failed(error.to_string()))?;
    Ok(trial)
}
