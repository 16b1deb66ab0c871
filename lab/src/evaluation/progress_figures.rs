//! Figures of the two objectives beside each other (Figure 2) and of the tuner's error against iterations and
//! run time.

use std::fmt::Write as _;

use treewright_renderer::statistics::{Summary, quantile};
use treewright_renderer::tuning::objective::Objective;

use super::folds::Split;
use super::judge::Verdict;
use super::plot::{Axis, Plot, escaped, legend};
use super::progress::{Moment, over_iterations, over_seconds};
use super::record::{Clock, GroupKind, Place, Record, Search};

/// The paper's two predictors, whom the curves of searches are shown beside.
const BESIDE: [(&str, &str); 2] = [("nearest_neighbour", "c0"), ("rbf_greedy_gq", "c1")];

/// Figure 2: what a search for either objective does to both, at a camera of a scene where both were run; of
/// sponza where there is one, as in the paper.
pub(crate) fn two_objectives(record: &Record, clock: Clock) -> Option<String> {
    let search = |place: &Place, objective: Objective| {
        record.searches.iter().find(|one| one.place == *place && one.objective == objective.name())
    };
    let both = |place: &&Place| Objective::ALL.iter().all(|objective| search(place, *objective).is_some());
    let places = || record.searches.iter().map(|search| &search.place).filter(both);
    let place = places().filter(|place| place.scene == "sponza").min().or_else(|| places().min())?;
    let mut text = format!(
        "<h2>What is minimised decides what is found (Figure 2)</h2><p class=\"soft\">{}, camera {}: time of each iteration of \
         a search for render time and of one for total time; dashed the recommended default.</p>",
        escaped(&place.scene),
        place.camera
    );
    text += &legend(&[("search for render time", "c0"), ("search for total time", "c6"), ("default", "c1")]);
    for shown in Objective::ALL {
        let of = |searched: Objective| -> Vec<[f64; 2]> {
            let iterations = search(place, searched).into_iter().flat_map(|search| &search.iterations);
            let numbered = iterations.enumerate();
            numbered
                .filter_map(|(number, one)| {
                    Some([(number + 1) as f64, clock.cost(shown, one.times.as_ref()?)?])
                })
                .collect()
        };
        let curves = Objective::ALL.map(of);
        let default = record.groups.get(&(GroupKind::Fixed, place.clone())).and_then(|group| {
            let rounds = &group.members.first()?.rounds;
            let costs: Vec<f64> = rounds.iter().filter_map(|times| clock.cost(shown, times)).collect();
            (!costs.is_empty()).then(|| Summary::of(&costs).median)
        });
        let mut all: Vec<f64> = curves.iter().flatten().map(|[_, ms]| *ms).chain(default).collect();
        all.sort_by(f64::total_cmp);
        // The few slowest iterations end at the edge.
        let most = quantile(&all, 0.97);
        let mut plot = Plot::new(
            Axis::linear(curves.iter().flatten().map(|[x, _]| *x)),
            Axis::linear(all.into_iter().filter(|ms| *ms <= most)),
            "iteration",
            &format!("{} time, ms", shown.name()),
            260.0,
        );
        for (curve, (searched, colour)) in curves.iter().zip(Objective::ALL.iter().zip(["c0", "c6"])) {
            plot.line(curve, colour, false, &format!("search for {} time", searched.name()));
        }
        if let Some(default) = default {
            plot.level(default, "c1", "recommended default");
        }
        let _ = write!(text, "<div class=\"card\">{}</div>", plot.finish());
    }
    Some(text)
}

/// The searches that a verdict is about.
fn searches<'a>(record: &'a Record, verdict: &Verdict) -> Vec<&'a Search> {
    let judged = |search: &&Search| verdict.grounds.iter().any(|ground| ground.place == search.place);
    let own = record.searches.iter().filter(|search| search.objective == verdict.objective.name());
    own.filter(judged).collect()
}

/// How far searches have come after so many iterations and so many seconds.
pub(crate) fn progress(record: &Record, verdict: &Verdict, clock: Clock) -> String {
    let searches = searches(record, verdict);
    let mut text = format!(
        "<h3>Error of the tuner against iterations and run time</h3><p class=\"soft\">Cost of the best configuration so far over that of \
         the best of all iterations: median of {} searches, and the middle half of them. Dashed: what the paper's two predictors answered on \
         {}, over the roofline, before any iteration. Seconds are of building and rendering.</p>",
        searches.len(),
        Split::Random.words()
    );
    text += &legend(&[("search", "c3"), (BESIDE[0].0, BESIDE[0].1), (BESIDE[1].0, BESIDE[1].1)]);
    for (moments, label) in [
        (over_iterations(&searches, verdict.objective, clock), "iterations"),
        (over_seconds(&searches, verdict.objective, clock), "seconds"),
    ] {
        let _ = write!(text, "<div class=\"card\">{}</div>", figure(&moments, verdict, label));
    }
    text
}

fn figure(moments: &[Moment], verdict: &Verdict, label: &str) -> String {
    let answers: Vec<(f64, &str, &str)> = BESIDE
        .iter()
        .filter_map(|(name, colour)| {
            let own = verdict.rows.iter().filter(|row| row.split == Split::Random && row.entrant == *name);
            let mut costs: Vec<f64> = own.map(|row| 1.0 / row.of_roofline).collect();
            costs.sort_by(f64::total_cmp);
            (!costs.is_empty()).then(|| (quantile(&costs, 0.5), *name, *colour))
        })
        .collect();
    let mut plot = Plot::new(
        Axis::logarithmic(moments.iter().map(|moment| moment.at)),
        Axis::linear(
            moments
                .iter()
                .flat_map(|moment| moment.quartiles)
                .chain(answers.iter().map(|(cost, ..)| *cost))
                .chain([1.0]),
        ),
        label,
        "cost over that of the roofline",
        280.0,
    );
    let band: Vec<[f64; 3]> =
        moments.iter().map(|moment| [moment.at, moment.quartiles[0], moment.quartiles[2]]).collect();
    plot.band(&band, "c3");
    let median: Vec<[f64; 2]> = moments.iter().map(|moment| [moment.at, moment.quartiles[1]]).collect();
    plot.line(&median, "c3", false, "median of the searches");
    for (cost, name, colour) in answers {
        plot.level(cost, colour, &format!("{name}: {cost:.3}"));
    }
    plot.finish()
}

/// The numbers behind these figures.
pub(crate) fn table(record: &Record, verdict: &Verdict, clock: Clock) -> String {
    let searches = searches(record, verdict);
    let mut text = String::from("axis,at,lower_quartile,median,upper_quartile,cameras\n");
    for (axis, moments) in [
        ("iterations", over_iterations(&searches, verdict.objective, clock)),
        ("seconds", over_seconds(&searches, verdict.objective, clock)),
    ] {
        for Moment { at, quartiles: [low, middle, high], cameras } in moments {
            let _ = writeln!(text, "{axis},{at:.4},{low:.5},{middle:.5},{high:.5},{cameras}");
        }
    }
    text
}
