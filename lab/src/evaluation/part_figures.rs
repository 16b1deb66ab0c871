//! Figures of the paper's section 4: parts of the space (6 to 8), splitting (4.1), turning needles (9).

use treewright_client::{Configuration, Value};
use treewright_figures::{Axis, Colour, Dot, Figure, Stroke};
use treewright_renderer::statistics::{Ratio, Summary};
use treewright_renderer::{frame::FrameTimes, tuning::objective::Objective};

use super::record::{Group, Member, PartSearch, Record, Versus, cost};
use super::{figures::WIDTH, parts::Part};
use crate::converge::bootstrap::{in_brackets, student};

/// Confidence of the bands in Figure 9.
const BAND: f64 = 0.9999;

pub(super) fn number(configuration: &Configuration, name: &str) -> Option<f64> {
    match configuration.get(name)? {
        Value::Integer(value) => Some(*value as f64),
        Value::Float(value) => Some(*value),
        _ => None,
    }
}

/// One search over a part: costs of its iterations with their configurations, failed ones left out.
pub(super) struct Run<'a> {
    pub(super) run: u32,
    /// Number of the iteration from 1, cost in milliseconds, configuration.
    pub(super) points: Vec<(usize, f64, &'a Configuration)>,
}

impl<'a> Run<'a> {
    pub(super) fn of(part: &'a PartSearch) -> Option<Self> {
        let objective = part.search.minimised()?;
        let points = part.search.iterations.iter().enumerate().filter_map(|(number, one)| {
            Some((number + 1, cost(objective, one.times.as_ref()?), &one.configuration))
        });
        Some(Self { run: part.run, points: points.collect() })
    }

    /// The last quarter of its iterations: where it has come to, by more than one measurement.
    pub(super) fn end(&self) -> &[(usize, f64, &'a Configuration)] {
        &self.points[self.points.len() - self.points.len().div_ceil(4)..]
    }
}

/// Speed of the searches' results over the default, all measured in shared rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PartGain {
    /// Of their geometric mean, round by round.
    pub(super) speed: Ratio,
    /// The least and the most of single searches.
    pub(super) ends: [f64; 2],
}

impl PartGain {
    /// `None` where any of them was not measured or cannot be run.
    pub(super) fn of(
        group: &Group,
        default: &Configuration,
        found: &[Configuration],
        objective: Objective,
    ) -> Option<Self> {
        let default = group.costs(default, objective)?;
        let found: Option<Vec<Vec<f64>>> = found.iter().map(|one| group.costs(one, objective)).collect();
        let found = found.filter(|found| !found.is_empty())?;
        let in_round = |round: usize| {
            let logarithms: Option<Vec<f64>> =
                found.iter().map(|costs| Some(costs.get(round)?.ln())).collect();
            Some((logarithms?.iter().sum::<f64>() / found.len() as f64).exp())
        };
        let together: Option<Vec<f64>> = (0..default.len()).map(in_round).collect();
        let single = found.iter().map(|costs| Ratio::of(&default, costs).median);
        let ends = single.fold([f64::INFINITY, 0.0], |[low, high], one| [one.min(low), one.max(high)]);
        Some(Self { speed: Ratio::of(&default, &together?), ends })
    }

    /// The gain and its interval, and that of single searches.
    pub(super) fn words(&self) -> [String; 2] {
        // A loss that rounds to zero is shown without a sign of loss.
        let gain = |speed: f64| format!("{:+.1}", ((speed - 1.0) * 1000.0).round() / 10.0 + 0.0);
        let [low, high] = self.ends.map(gain);
        let interval = in_brackets(self.speed.interval, gain);
        [format!("{} %{interval}", gain(self.speed.median)), format!("{low} to {high} %")]
    }
}

/// The points that the searches tried (later ones darker), and the evolution of the cost of each run.
pub(super) fn part(part: &Part, runs: &[Run<'_>], default_ms: Option<f64>) -> [String; 2] {
    let [x_name, y_name] = [part.parameters[0], part.parameters[1]];
    let place = |configuration: &Configuration| {
        Some([number(configuration, x_name)?, number(configuration, y_name)?])
    };
    let all: Vec<[f64; 2]> =
        runs.iter().flat_map(|run| &run.points).filter_map(|(_, _, one)| place(one)).collect();
    let x = Axis::linear(x_name, all.iter().map(|[x, _]| *x));
    let y = Axis::linear(y_name, all.iter().map(|[_, y]| *y));
    let mut points = Figure::new(&format!("{y_name} over {x_name}"), [WIDTH, 340.0], x, y);
    let measured = || runs.iter().flat_map(|run| &run.points);
    let x = Axis::linear("iteration", measured().map(|point| point.0 as f64));
    let y = Axis::robust("ms", measured().map(|point| point.1), default_ms);
    let mut evolution = Figure::new("ms over iteration", [WIDTH, 260.0], x, y);
    for (index, run) in runs.iter().enumerate() {
        let (colour, name) = (Colour::of(index), format!("run {}", run.run + 1));
        let count = run.points.last().map_or(1, |point| point.0) as f64;
        for (iteration, _, configuration) in &run.points {
            if let Some(at) = place(configuration) {
                let opacity = 0.15 + 0.6 * (*iteration as f64 / count).powi(2);
                points.dot(at, Dot::Shade(opacity), colour, "");
            }
        }
        let curve: Vec<[f64; 2]> = run.points.iter().map(|point| [point.0 as f64, point.1]).collect();
        evolution.line(&curve, Stroke::Solid, colour, &name);
        points.dot_key(Dot::Small, colour, &name);
    }
    if let Some(default_ms) = default_ms {
        let name = "recommended default, measured again";
        evolution.level(default_ms, Stroke::Dashed, Colour::Ink, name);
    }
    [points.finish(), evolution.finish()]
}

/// A part of a frame, by its name, in milliseconds.
pub(super) type Share = (&'static str, fn(&FrameTimes) -> f64);

pub(super) const SHARES: [Share; 3] =
    [("build", |times| times.build_ms), ("render", |times| times.render_ms), TOTAL];
const TOTAL: Share = ("total", |times| times.build_ms + times.render_ms);

/// Milliseconds of each round without and with splitting; nothing where either could not be built.
fn rounds(group: &Group, (_, of_times): Share) -> Option<[Vec<f64>; 2]> {
    let of = |member: &Member| -> Option<Vec<f64>> {
        let times = member.rounds.iter().map(of_times);
        (!member.rounds.is_empty() && member.failure.is_none()).then(|| times.collect())
    };
    let [without, with] = group.members.as_slice() else { return None };
    Some([of(without)?, of(with)?])
}

/// The mean, and half its 99.99 % interval by Student's distribution; none for fewer than three values.
pub(super) fn mean_and_band(values: &[f64]) -> (f64, Option<f64>) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    if values.len() < 3 {
        return (mean, None);
    }
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, student(count - 1.0, BAND).map(|student| student * (variance / count).sqrt()))
}

/// A frame height, the medians of total time without and with splitting, and the speed-up.
pub(super) type AtHeight = (u32, [f64; 2], Ratio);

/// Frame heights of a scene with what splitting gains in total time there.
pub(super) fn heights(record: &Record, scene: &str) -> Vec<AtHeight> {
    let own = record.pairs.iter().filter(|((name, _), _)| name == scene);
    own.filter_map(|((_, versus), group)| {
        let Versus::Height(height) = versus else { return None };
        let [without, with] = rounds(group, TOTAL)?;
        let medians = [Summary::of(&without).median, Summary::of(&with).median];
        Some((*height, medians, Ratio::of(&without, &with)))
    })
    .collect()
}

/// The height at which splitting begins to pay, by interpolation between pixels on logarithmic axes.
pub(super) fn turning_height(heights: &[AtHeight]) -> Option<f64> {
    heights.windows(2).find_map(|pair| {
        let [(low, _, before), (high, _, after)] = pair else { return None };
        let (a, b) = (before.median.ln(), after.median.ln());
        (a < 0.0 && b >= 0.0).then(|| {
            let share = a / (a - b);
            (f64::from(*low).ln() * (1.0 - share) + f64::from(*high).ln() * share).exp()
        })
    })
}

/// Speed of a frame with splitting over one without it, by frame height, a curve a scene.
pub(super) fn splitting(scenes: &[(&str, Vec<AtHeight>)]) -> String {
    let all = || scenes.iter().flat_map(|(_, heights)| heights);
    let ends = |(_, _, ratio): &AtHeight| ratio.interval.unwrap_or([ratio.median; 2]);
    let x = Axis::logarithmic("frame height, pixels", all().map(|one| f64::from(one.0)));
    let y = Axis::linear("speed with over without", all().flat_map(ends).chain([1.0]));
    let title = "speed with over without over frame height, pixels";
    let mut figure = Figure::new(title, [WIDTH, 300.0], x, y);
    figure.level(1.0, Stroke::Dashed, Colour::Ink, "as fast with splitting as without");
    for (index, (scene, heights)) in scenes.iter().enumerate() {
        let colour = Colour::of(index);
        let points: Vec<[f64; 2]> =
            heights.iter().map(|(height, _, ratio)| [f64::from(*height), ratio.median]).collect();
        figure.line(&points, Stroke::Solid, colour, scene);
        let band: Vec<[f64; 3]> = heights
            .iter()
            .map(|one| {
                let [low, high] = ends(one);
                [f64::from(one.0), low, high]
            })
            .collect();
        figure.band(&band, colour);
    }
    figure.finish()
}

/// Angles of a scene in degrees, with the rounds without and with splitting.
pub(super) fn angles(record: &Record, scene: &str, share: Share) -> Vec<(f64, [Vec<f64>; 2])> {
    let own = record.pairs.iter().filter(|((name, _), _)| name == scene);
    let mut all: Vec<(f64, [Vec<f64>; 2])> = own
        .filter_map(|((_, versus), group)| {
            let Versus::Needles { angle, angles } = versus else { return None };
            Some((f64::from(*angle) * 360.0 / f64::from(*angles), rounds(group, share)?))
        })
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// Mean time by angle without and with splitting, each with its band.
pub(super) fn needles(angles: &[(f64, [Vec<f64>; 2])], (name, _): Share) -> String {
    let points: Vec<_> = angles
        .iter()
        .map(|(angle, [without, with])| (*angle, [mean_and_band(without), mean_and_band(with)]))
        .collect();
    let means = || points.iter().flat_map(|(_, both)| both).map(|(mean, _)| *mean);
    // Bands of few rounds may be wide; they end at the edge.
    let most = means().fold(0.0_f64, f64::max) * 1.25;
    let least = means().fold(f64::INFINITY, f64::min) * 0.8;
    let (of_x, of_y) = ("angle of the cylinder, degrees", format!("{name} time, ms"));
    let x = Axis::linear(of_x, points.iter().map(|(angle, _)| *angle));
    let y = Axis::linear(&of_y, [least, most]);
    let mut figure = Figure::new(&format!("{of_y} over {of_x}"), [WIDTH, 260.0], x, y);
    for (which, colour, name) in
        [(0, Colour::Blue, "without splitting"), (1, Colour::Vermilion, "with splitting")]
    {
        let band: Vec<[f64; 3]> = points
            .iter()
            .filter_map(|(angle, both)| {
                let (mean, band) = both[which];
                Some([*angle, mean - band?, mean + band?])
            })
            .collect();
        figure.band(&band, colour);
        let line: Vec<[f64; 2]> = points.iter().map(|(angle, both)| [*angle, both[which].0]).collect();
        figure.line(&line, Stroke::Solid, colour, name);
    }
    figure.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_students() {
        // 1, 2, 3: mean 2, standard error 1/sqrt(3), t of 99.99 % with two degrees of freedom 99.99.
        let (mean, band) = mean_and_band(&[1.0, 2.0, 3.0]);
        let band = band.expect("three are enough");
        assert!((mean - 2.0).abs() < 1e-12 && (band * 3.0_f64.sqrt() - 99.992).abs() < 0.05, "{band}");
        assert_eq!(mean_and_band(&[1.0, 2.0]).1, None);
    }

    #[test]
    fn splitting_pays_where_the_curve_crosses_one() {
        let ratio = |median: f64| Ratio { median, interval: None, count: 3 };
        let heights = [(100, [1.0; 2], ratio(0.5)), (400, [1.0; 2], ratio(2.0))];
        assert!((turning_height(&heights).expect("it crosses") - 200.0).abs() < 1e-9);
        assert_eq!(turning_height(&heights[1..]), None);
    }
}
