//! An analysis as one page without anything from outside: figures as SVG, light and dark, as narrow as a
//! telephone.

use std::fmt::Write as _;

use treewright_figures::{Axis, Colour, Figure, escaped};

use super::dependence::Correlation;
use super::map::{Cell, Map};
use super::narrow::{Narrowed, Spread};
use super::table::{quantile, rounded, sorted};
use super::{Analysis, CONFIGURATIONS_PER_PARAMETER, Condition, Influence, Metric, titled};

const STYLE: &str = "\
:root{color-scheme:light dark;--paper:#fbfaf7;--card:#fff;--ink:#1d1f24;--soft:#5c616b;--line:#dcdad4}\
@media(prefers-color-scheme:dark){:root{--paper:#16181c;--card:#1f2228;--ink:#e9e7e2;--soft:#a4a8b1;--line:#3a3e46}}\
*{box-sizing:border-box}body{margin:0;background:var(--paper);color:var(--ink);font:1rem/1.55 system-ui,sans-serif}\
main{max-width:60rem;margin:0 auto;padding:1.2rem .8rem 4rem}h1{line-height:1.2}h2{margin:2.4rem 0 .4rem}h3{margin:1.4rem 0 .3rem}\
p{max-width:46rem}.soft{color:var(--soft);font-size:.9rem}\
.grid{display:grid;gap:.8rem;grid-template-columns:repeat(auto-fit,minmax(min(21rem,100%),1fr))}\
.card{background:var(--card);border:1px solid var(--line);border-radius:.5rem;padding:.6rem;min-width:0}\
table{border-collapse:collapse;width:100%;font-size:.82rem;font-variant-numeric:tabular-nums}\
th,td{padding:.22rem .25rem;text-align:right;border-bottom:1px solid var(--line)}th:first-child,td:first-child{text-align:left;overflow-wrap:anywhere}\
th{color:var(--soft);font-weight:600}svg{display:block;width:100%;height:auto}code{font-size:.88em;overflow-wrap:anywhere}";

pub(crate) fn html(analysis: &Analysis) -> String {
    let mut page = String::new();
    let Analysis { study, trials, infeasible, states, random, .. } = analysis;
    let study = escaped(study);
    let _ = write!(
        page,
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{study}: what its parameters do</title><style>{STYLE}</style></head><body><main>\n\
         <h1>{study}: what its parameters do</h1>\n<p>{}</p>\n<p class=\"soft\">{trials} trials in {states} state(s); {infeasible} infeasible ones left out. \
         {} Every measurement is divided by the geometric mean of its state.</p>\n",
        escaped(&headline(analysis)),
        if *random {
            "Configurations were drawn at random, so parameters do not depend on each other."
        } else {
            "Configurations come from a search, which tries some regions more than others. Parameters may seem to matter \
             because they changed together with others."
        }
    );
    for objective in &analysis.objectives {
        narrowed(&mut page, objective);
    }
    if !analysis.maps.is_empty() {
        page += "<h2>Maps</h2><p class=\"soft\">Median for each pair of values, divided by the mean of its state.</p><div class=\"grid\">";
        for map in &analysis.maps {
            page += &drawn(map);
        }
        page += "</div>\n";
    }
    for condition in &analysis.conditions {
        section(&mut page, condition);
    }
    page += "<h2>How to read this</h2><p>Pearson's r and Spearman's rank correlation range from −1 (higher values mean less of the measurement) to 1 (higher values mean more). \
             Bars show r, orange where higher values are worse, and are pale where its 95 % interval contains 0. Mutual information, in bits, measures any kind of \
             dependence. The share is the part of the variance of its logarithm that a parameter explains on its own, in \
             configurations that were left out of the estimate; for pairs, the part beyond that of both alone. Only trials in \
             which a parameter is active count; with fewer than 20 configurations there is no share.</p>\n</main></body></html>\n";
    page
}

/// The most important influences, in words.
pub(crate) fn headline(analysis: &Analysis) -> String {
    let all = analysis.conditions.first().map(|all| all.metrics.as_slice()).unwrap_or_default();
    if analysis.has_few() {
        let (configurations, varied) = (analysis.configurations, analysis.varied);
        return format!(
            "Too few trials: {configurations} different configurations do not tell {varied} parameters apart, so shares are \
             uncertain. Record {} or more, best at random.",
            CONFIGURATIONS_PER_PARAMETER * varied
        );
    }
    let strongest = all.iter().take(3).filter_map(|metric| {
        let first = metric.parameters.first()?;
        let share = first.first_order.filter(|share| *share >= 0.01)?;
        let name = &metric.name;
        Some(format!("{} explains {:.0} % of {name}'s variance", first.parameter, share * 100.0))
    });
    let statements: Vec<String> = strongest.collect();
    if statements.is_empty() {
        "No single parameter explains 1 % or more of any measurement.".into()
    } else {
        statements.join("; ") + "."
    }
}

fn section(page: &mut String, condition: &Condition) {
    let title = match condition.filter.as_str() {
        "" => "All trials".to_owned(),
        filter => format!("Where {filter}"),
    };
    let _ = write!(
        page,
        "<h2>{}</h2><p class=\"soft\">{} trials.</p><div class=\"grid\">",
        escaped(&title),
        condition.trials
    );
    for metric in &condition.metrics {
        card(page, metric);
    }
    *page += "</div>\n";
}

fn card(page: &mut String, metric: &Metric) {
    let [low, high] = metric.relative_quartiles;
    let _ = write!(
        page,
        "<div class=\"card\"><h3>{}</h3><p class=\"soft\">median {}, middle 50 % between {low:.2} and {high:.2} times the mean of its state</p>{}\
         <table><tr><th></th><th>r</th><th>rank</th><th>bits</th><th>share</th></tr>",
        escaped(&titled(&metric.name, metric.higher_is_better)),
        rounded(metric.median),
        bars(&metric.parameters, metric.higher_is_better)
    );
    for one in &metric.parameters {
        let r = |of: &Option<Correlation>| of.map_or("–".to_owned(), |of| format!("{:.2}", of.r));
        let _ = write!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{:.3}</td><td>{}</td></tr>",
            escaped(&one.parameter),
            r(&one.correlation),
            r(&one.rank_correlation),
            one.mutual_information_bits,
            one.share()
        );
    }
    *page += "</table>";
    if !metric.pairs.is_empty() {
        let pairs = metric.pairs.iter().take(4).map(|pair| {
            format!("{} with {} {:.1} %", pair.parameters[0], pair.parameters[1], pair.interaction * 100.0)
        });
        let _ = write!(
            page,
            "<p class=\"soft\">Together: {}.</p>",
            escaped(&pairs.collect::<Vec<_>>().join("; "))
        );
    }
    *page += "</div>\n";
}

/// Correlations as bars from the middle, with their intervals.
fn bars(parameters: &[Influence], higher_is_better: bool) -> String {
    let ordered: Vec<(&str, Correlation)> =
        parameters.iter().filter_map(|one| Some((one.parameter.as_str(), one.correlation?))).collect();
    if ordered.is_empty() {
        return String::new();
    }
    let names: Vec<&str> = ordered.iter().map(|(name, _)| *name).collect();
    let mut figure = Figure::of_rows("Correlations", 340.0, Axis::between("r", -1.0, 1.0), &names);
    for (row, (_, correlation)) in ordered.iter().enumerate() {
        let Correlation { r, interval: [low, high] } = *correlation;
        let (colour, name) = match (r < 0.0) == higher_is_better {
            true => (Colour::Vermilion, "higher is worse"),
            false => (Colour::Blue, "higher is better"),
        };
        let opacity = if correlation.is_there() { 1.0 } else { 0.35 };
        figure.bar(row, [r.min(0.0), r.max(0.0)], opacity, colour, "");
        figure.area_key(colour, name);
        let middle = row as f64 + 0.5;
        figure.interval([low, middle], [high, middle], Colour::Ink);
    }
    figure.finish()
}

fn narrowed(page: &mut String, narrowed: &Narrowed) {
    let Narrowed { metric, higher_is_better, narrowed, arguments, whole, part } = narrowed;
    let _ = write!(page, "<h2>Recommended ranges for {}</h2>", escaped(&titled(metric, *higher_is_better)));
    let worse = if *higher_is_better { "below" } else { "above" };
    if narrowed.is_empty() {
        *page += "<p>None: the best trials are spread over the whole range of every parameter.</p>\n";
        return;
    }
    let _ = write!(
        page,
        "<p>Search with <code>{}</code>.</p><p class=\"soft\">Effect on trials that were not used to choose this:</p>\
         <div class=\"card\"><table><tr><th></th><th>trials</th><th>best</th><th>median</th><th>1 in 10 {worse}</th><th>worst</th></tr>",
        escaped(arguments)
    );
    for (name, Spread { trials, best, median, dear, worst }) in [("whole space", whole), ("this part", part)]
    {
        match trials {
            0 => {
                let _ = write!(
                    page,
                    "<tr><td>{name}</td><td>0</td><td>–</td><td>–</td><td>–</td><td>–</td></tr>"
                );
            }
            _ => {
                let _ = write!(
                    page,
                    "<tr><td>{name}</td><td>{trials}</td><td>{best:.2}</td><td>{median:.2}</td><td>{dear:.2}</td><td>{worst:.2}</td></tr>"
                );
            }
        }
    }
    *page += "</table></div>\n";
}

/// A map as coloured cells, from the best of its values to the worst. The worst tenth share a colour, so that
/// a single bad cell does not make all others alike.
fn drawn(map: &Map) -> String {
    let values = sorted(map.cells.iter().map(|cell| cell.relative));
    let [best, worst] = if map.higher_is_better { [1.0, 0.1] } else { [0.0, 0.9] };
    let [best, worst] = [best, worst].map(|share| quantile(&values, share));
    let axis = |which: usize| {
        let edges = &map.edges[which];
        let cells = edges.len() - 1;
        let labels = [0, cells / 2, cells].map(|edge| (edge as f64, rounded(edges[edge])));
        Axis::labelled(&map.parameters[which], [0.0, cells as f64], labels.into())
    };
    let mut figure = Figure::new("Map", [340.0, 270.0], axis(0), axis(1));
    for Cell { at, trials, relative } in &map.cells {
        let [x, y] = at.map(|index| [index as f64, index as f64 + 1.0]);
        let share = if best == worst { 0.5 } else { (relative - best) / (worst - best) };
        figure.cell(x, y, 1.0, Colour::Scale(share), &format!("{trials} trials: {relative:.3}"));
    }
    figure.scale_key(&format!("{best:.2}"), &format!("{worst:.2} and worse"));
    let title = escaped(&titled(&map.metric, map.higher_is_better));
    format!("<div class=\"card\"><h3>{title}</h3>{}</div>", figure.finish())
}
