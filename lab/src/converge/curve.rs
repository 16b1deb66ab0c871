//! Several contenders render one view progressively; their errors are noted over time.
//!
//! The machine's speed drifts, so contenders take turns frame by frame and each turn begins with another one.
//! Within a run all have one seed: after as many samples their pictures are equal, and only the time differs.
//! Runs have seeds of their own and are independent of one another. Each run rebuilds each structure. Errors
//! are measured while no clock runs.

use serde::Serialize;
use treewright_accel::Structure;

use super::metrics::Yardstick;
use treewright_renderer::{
    film::Film, frame::Renderer, integrator::View, render_options::RenderOptions, space::Choice,
    tuning::verdict::Rival, tuning::who::Who,
};

#[derive(Clone, Debug)]
pub(crate) struct Entrant {
    pub(crate) rival: Rival,
    /// Time that went into finding the configuration: tuning, or asking for a prediction.
    pub(crate) setup_ms: f64,
    /// Where the configuration comes from, in words.
    pub(crate) origin: String,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct ComparisonPlan {
    /// Its seed is the first run's.
    pub(crate) view: View,
    pub(crate) runs: u32,
    /// Time that each contender gets in each run for building and rendering.
    pub(crate) budget_ms: f64,
    pub(crate) samples_max: u32,
}

/// A contender's picture after some time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Point {
    pub(crate) samples: u32,
    pub(crate) render_ms: f64,
    /// Relative mean squared error, the reference's own included.
    pub(crate) relative_mse: f64,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Run {
    pub(crate) seed: u64,
    pub(crate) build_ms: f64,
    /// At powers of √2 samples.
    pub(crate) points: Vec<Point>,
    /// When the time was up.
    pub(crate) end: Point,
}

impl Run {
    /// All points in order of time.
    pub(crate) fn all_points(&self) -> impl Iterator<Item = &Point> {
        let last = self.points.last().map(|point| point.samples);
        self.points.iter().chain(Some(&self.end).filter(move |end| last != Some(end.samples)))
    }
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Curve {
    #[serde(rename = "name")]
    pub(crate) who: Who,
    pub(crate) choice: Choice,
    pub(crate) setup_ms: f64,
    pub(crate) runs: Vec<Run>,
    /// Why there is nothing, if the structure cannot be built.
    pub(crate) failure: Option<String>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Progress {
    /// The run, counted from 0.
    pub(crate) run: u32,
    /// The share of it that is done, 0 to 1.
    pub(crate) share: f64,
}

/// Compares the entrants after a warming round. `go_on` is asked before each frame; no ends it.
pub(crate) fn compare(
    renderer: &mut Renderer,
    entrants: &[Entrant],
    plan: &ComparisonPlan,
    yardstick: &Yardstick,
    mut go_on: impl FnMut(Progress) -> bool,
) -> Vec<Curve> {
    let mut curves: Vec<Curve> = entrants
        .iter()
        .map(|Entrant { rival: Rival { contender, .. }, setup_ms, .. }| Curve {
            who: contender.who.clone(),
            choice: contender.choice,
            setup_ms: *setup_ms,
            runs: Vec::new(),
            failure: None,
        })
        .collect();
    let reference = yardstick.reference();
    let size = [reference.width, reference.height];
    for run in 0..plan.runs {
        let view = View { seed: run_seed(plan.view.seed, run), ..plan.view };
        let mut lanes: Vec<(usize, Lane)> = Vec::new();
        for turn in 0..entrants.len() {
            let index = (run as usize + turn) % entrants.len();
            if curves[index].failure.is_some() {
                continue;
            }
            match renderer.build(&curves[index].choice.build) {
                Ok((structure, build_ms)) => {
                    // A contender that learns where light comes from pays for it in each run.
                    let light = curves[index].choice.light;
                    let learning_ms = match light.learns() {
                        true => renderer.learn_light_with(&structure, &view, size).of(&light),
                        false => 0.0,
                    };
                    lanes.push((index, Lane::new(structure, build_ms + learning_ms, size)));
                }
                Err(error) => curves[index].failure = Some(error.to_string()),
            }
        }
        if run == 0 {
            let mut film = Film::new(size);
            for (index, lane) in &lanes {
                renderer.set_light_sampling(curves[*index].choice.light);
                renderer.render_with(&lane.structure, &view, &curves[*index].choice.render, &mut film);
            }
        }
        let count = lanes.len();
        let mut turn = 0;
        while lanes.iter().any(|(_, lane)| lane.end.is_none()) {
            let share = lanes.iter().map(|(_, lane)| lane.share(plan)).fold(1.0, f64::min);
            if !go_on(Progress { run, share }) {
                return curves;
            }
            for offset in 0..count {
                let (index, lane) = &mut lanes[(turn + offset) % count];
                renderer.set_light_sampling(curves[*index].choice.light);
                lane.advance(renderer, &view, &curves[*index].choice.render, plan, yardstick);
            }
            turn += 1;
        }
        for (index, lane) in lanes {
            if let Some(end) = lane.end {
                let run = Run { seed: view.seed, build_ms: lane.build_ms, points: lane.points, end };
                curves[index].runs.push(run);
            }
        }
    }
    curves
}

/// Seeds of runs. Small seeds that people give must not lead to runs that share samples.
fn run_seed(seed: u64, run: u32) -> u64 {
    seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(run))
}

/// Whether errors are measured after `samples` samples: at powers of √2, rounded.
fn is_checkpoint(samples: u32) -> bool {
    let power = 2.0 * f64::from(samples).log2();
    let nearest = 2.0_f64.powf(power.round() * 0.5).round();
    nearest == f64::from(samples)
}

struct Lane {
    structure: Structure,
    build_ms: f64,
    film: Film,
    render_ms: f64,
    points: Vec<Point>,
    end: Option<Point>,
}

impl Lane {
    fn new(structure: Structure, build_ms: f64, size: [u32; 2]) -> Self {
        let film = Film::new(size);
        Self { structure, build_ms, film, render_ms: 0.0, points: Vec::new(), end: None }
    }

    fn spent_ms(&self) -> f64 {
        self.build_ms + self.render_ms
    }

    fn share(&self, plan: &ComparisonPlan) -> f64 {
        let samples = f64::from(self.film.samples()) / f64::from(plan.samples_max);
        (self.spent_ms() / plan.budget_ms).max(samples).min(1.0)
    }

    /// Renders one sample more, if there is time left, and measures where it is due.
    fn advance(
        &mut self,
        renderer: &Renderer,
        view: &View,
        options: &RenderOptions,
        plan: &ComparisonPlan,
        yardstick: &Yardstick,
    ) {
        if self.end.is_some() {
            return;
        }
        self.render_ms += renderer.render_with(&self.structure, view, options, &mut self.film).0;
        let samples = self.film.samples();
        let is_end = self.spent_ms() >= plan.budget_ms || samples >= plan.samples_max;
        if !(is_end || is_checkpoint(samples)) {
            return;
        }
        let relative_mse = yardstick.relative_mse(&self.film.picture());
        let point = Point { samples, render_ms: self.render_ms, relative_mse };
        if is_checkpoint(samples) {
            self.points.push(point);
        }
        if is_end {
            self.end = Some(point);
        }
    }
}

#[cfg(test)]
mod tests {
    use treewright_accel::{BuildChoice, NativeOptions, NativeQuality, TreeParameters};

    use super::*;
    use crate::{converge::reference::Reference, converge::testing::matt_scene};
    use treewright_renderer::measure::Contender;

    #[test]
    fn checkpoints_are_powers_of_the_root_of_two() {
        let found: Vec<u32> = (1..200).filter(|&samples| is_checkpoint(samples)).collect();
        assert_eq!(found, [1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 91, 128, 181]);
    }

    #[test]
    fn contenders_have_the_same_pictures_at_their_own_times() {
        let (mut renderer, view) = matt_scene();
        let low = NativeOptions { quality: NativeQuality::Low, ..NativeOptions::default() };
        let entrant = |name: &'static str, build: BuildChoice, setup_ms| {
            let contender = Contender { who: Who::Named(name.into()), choice: build.into() };
            Entrant { rival: contender.into(), setup_ms, origin: String::new() }
        };
        let impossible = TreeParameters { branching_factor: 3, ..TreeParameters::default() };
        let entrants = [
            entrant("tree", BuildChoice::Tree(TreeParameters::default()), 0.0),
            entrant("native", BuildChoice::Native(low), 1e9),
            entrant("impossible", BuildChoice::Tree(impossible), 0.0),
        ];
        let structure = renderer.build(&entrants[0].rival.contender.choice.build).expect("it can be built").0;
        let options = RenderOptions::default();
        let reference = Reference::rendered(&renderer, &structure, &view, &options, [24, 16], 512, || true);
        let yardstick = Yardstick::new(reference.picture());
        let plan = ComparisonPlan { view, runs: 3, budget_ms: 1e9, samples_max: 25 };
        let mut last = 0.0;
        let curves = compare(&mut renderer, &entrants, &plan, &yardstick, |progress| {
            assert!(progress.run as f64 + progress.share >= last);
            last = progress.run as f64 + progress.share;
            true
        });
        assert!(curves[2].failure.is_some() && curves[2].runs.is_empty());
        for run in 0..3 {
            let [tree, native] = [&curves[0].runs[run], &curves[1].runs[run]];
            assert_eq!(tree.seed, native.seed);
            assert_eq!(
                tree.all_points().map(|point| point.samples).collect::<Vec<_>>(),
                [1, 2, 3, 4, 6, 8, 11, 16, 23, 25]
            );
            for (a, b) in tree.all_points().zip(native.all_points()) {
                let ratio = a.relative_mse / b.relative_mse;
                assert!((0.9..1.1).contains(&ratio), "equal samples, {ratio} of the error");
                assert!(a.render_ms > 0.0 && b.render_ms > 0.0);
            }
            assert!(tree.points[8].relative_mse < tree.points[0].relative_mse / 6.0);
        }
        assert_ne!(curves[0].runs[0].points[0].relative_mse, curves[0].runs[1].points[0].relative_mse);

        let stopped = compare(&mut renderer, &entrants, &plan, &yardstick, |progress| progress.run < 1);
        assert_eq!(stopped[0].runs.len(), 1, "complete runs are kept");
    }
}
