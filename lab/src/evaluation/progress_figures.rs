//! Figures of the two objectives (Figure 2), and of the tuner's error against iterations and run time.

use std::fmt::Write as _;

use treewright_figures::{Axis, Colour, Figure, Stroke, escaped, number};
use treewright_renderer::{statistics::Summary, tuning::objective::Objective};

use super::markup::{self, card};
use super::progress::{DEFAULT, Moment, SEARCH, of_searches, reached, without_search};
use super::record::{GroupKind, Place, Record, cost};
use super::{answers::SERVICE, figures::WIDTH, folds::Split, judge::Verdict, summary::Mean};

/// The paper's two predictors and the service, whom the curves of searches are shown beside.
const BESIDE: [(&str, Colour); 3] =
    [("nearest_neighbour", Colour::Green), ("rbf_greedy_gq", Colour::Purple), (SERVICE, Colour::Vermilion)];

/// Figure 2: a search for either objective, and both costs, at a camera of sponza if there is one.
pub(crate) fn two_objectives(record: &Record) -> Option<String> {
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
    for shown in Objective::ALL {
        let of = |searched: Objective| -> Vec<[f64; 2]> {
            let iterations = search(place, searched).into_iter().flat_map(|search| &search.iterations);
            let numbered = iterations.enumerate();
            numbered
                .filter_map(|(number, one)| Some([(number + 1) as f64, cost(shown, one.times.as_ref()?)]))
                .collect()
        };
        let curves = Objective::ALL.map(of);
        let default = record.groups.get(&(GroupKind::Fixed, place.clone())).and_then(|group| {
            let rounds = &group.members.first()?.rounds;
            let costs: Vec<f64> = rounds.iter().map(|times| cost(shown, times)).collect();
            (!costs.is_empty()).then(|| Summary::of(&costs).median)
        });
        let label = format!("{} time, ms", shown.name());
        let x = Axis::linear("iteration", curves.iter().flatten().map(|[x, _]| *x));
        let y = Axis::robust(&label, curves.iter().flatten().map(|[_, ms]| *ms), default);
        let mut figure = Figure::new(&format!("{label} over iteration"), [WIDTH, 260.0], x, y);
        for (index, (curve, searched)) in curves.iter().zip(Objective::ALL).enumerate() {
            let name = format!("search for {} time", searched.name());
            figure.line(curve, Stroke::Solid, Colour::of(index), &name);
        }
        if let Some(default) = default {
            figure.level(default, Stroke::Dashed, Colour::Ink, "recommended default");
        }
        text += &card(&figure.finish());
    }
    Some(text)
}

fn moments(record: &Record, verdict: &Verdict) -> [Vec<Moment>; 2] {
    [without_search(verdict, &BESIDE.map(|(name, _)| name)), of_searches(record, verdict)]
}

/// The figure of the searches' progress over trials and over time, beside the answers without a search.
pub(crate) fn progress(record: &Record, verdict: &Verdict) -> String {
    let [at_once, searched] = moments(record, verdict);
    let mut text = format!(
        "<h3>Error of the tuner against run time</h3><p class=\"soft\">Cost over that of the roofline. What a search had found after that number of \
         trials was measured again in shared, interleaved rounds with the roofline, the default, the best fixed configuration of the other \
         scenes, and the answers on {}. Geometric means over the cameras, with intervals of 95 % by resampling cameras. Seconds are of building \
         and rendering, median of the cameras.</p>",
        Split::Random.words()
    );
    if !verdict.is_whole() {
        let _ = write!(
            text,
            "<p class=\"warn\">Measured in shared rounds at {} of {} cameras. Costs of the search, the default and the best fixed \
             configuration are left out; <code>evaluate verify</code> measures them.</p>",
            verdict.same_rounds, verdict.cameras
        );
    }
    text += &table_of(&at_once, &searched);
    if verdict.is_whole() {
        for (at, label) in [(trials as fn(&Moment) -> f64, "trials"), (seconds, "seconds")] {
            text += &card(&figure(&at_once, &searched, at, label));
        }
    }
    text
}

fn trials(moment: &Moment) -> f64 {
    moment.trials as f64
}

fn seconds(moment: &Moment) -> f64 {
    moment.seconds
}

fn colour(who: &str) -> Colour {
    let beside = BESIDE.iter().find(|(name, _)| *name == who);
    beside.map_or(if who == DEFAULT { Colour::Ink } else { Colour::Amber }, |(_, colour)| *colour)
}

fn table_of(at_once: &[Moment], searched: &[Moment]) -> String {
    let heads = ["", "seconds", "cost over roofline", "cameras", "the search is there after"];
    let row = |moment: &Moment| {
        let name = match moment.trials {
            0 => moment.who.clone(),
            trials => format!("{SEARCH}, {trials} trials"),
        };
        let there =
            moment.cost.filter(|_| moment.trials == 0 && searched.iter().any(|one| one.cost.is_some()));
        vec![
            name,
            number(moment.seconds),
            moment.cost.map_or_else(String::new, |cost| cost.to_string()),
            moment.cost.map_or_else(String::new, |_| moment.cameras.to_string()),
            there.map_or_else(String::new, |cost| match reached(searched, cost.mean) {
                Some(there) => format!("{} trials, {} s", there.trials, number(there.seconds)),
                None => "never".to_owned(),
            }),
        ]
    };
    markup::table(&heads, &at_once.iter().chain(searched).map(row).collect::<Vec<_>>())
}

fn figure(at_once: &[Moment], searched: &[Moment], at: fn(&Moment) -> f64, label: &str) -> String {
    let ends = |cost: &Mean| cost.interval.unwrap_or([cost.mean; 2]);
    let costs: Vec<(f64, Mean)> = searched.iter().filter_map(|one| Some((at(one), one.cost?))).collect();
    let levels: Vec<(&str, Mean)> =
        at_once.iter().filter_map(|one| Some((one.who.as_str(), one.cost?))).collect();
    let x = Axis::logarithmic(label, costs.iter().map(|(at, _)| *at));
    let means = levels.iter().map(|(_, cost)| cost.mean).chain([1.0]);
    let of_y = "cost over that of the roofline";
    let y = Axis::linear(of_y, costs.iter().flat_map(|(_, cost)| ends(cost)).chain(means));
    let mut figure = Figure::new(&format!("{of_y} over {label}"), [WIDTH, 280.0], x, y);
    let band: Vec<[f64; 3]> = costs
        .iter()
        .map(|(at, cost)| {
            let [low, high] = ends(cost);
            [*at, low, high]
        })
        .collect();
    figure.band(&band, Colour::Blue);
    let means: Vec<[f64; 2]> = costs.iter().map(|(at, cost)| [*at, cost.mean]).collect();
    figure.line(&means, Stroke::Solid, Colour::Blue, "searches, measured again");
    for (name, cost) in levels {
        figure.level(cost.mean, Stroke::Dashed, colour(name), &format!("{name}: {cost}"));
    }
    figure.finish()
}

pub(crate) fn table(record: &Record, verdict: &Verdict) -> String {
    let mut text = String::from("who,trials,seconds,cost_over_roofline,low,high,cameras\n");
    for Moment { who, trials, seconds, cost, cameras } in moments(record, verdict).concat() {
        let [low, high] = cost.and_then(|cost| cost.interval).map_or([None; 2], |ends| ends.map(Some));
        let [mean, low, high] = [cost.map(|cost| cost.mean), low, high]
            .map(|value| value.map_or_else(String::new, |value| format!("{value:.5}")));
        let _ = writeln!(text, "\"{who}\",{trials},{seconds:.4},{mean},{low},{high},{cameras}");
    }
    text
}
