//! The evaluation as one page of words, tables and figures, and the numbers behind it as CSV.

use std::{collections::BTreeMap, fmt::Write as _};

use treewright_figures::escaped;
use treewright_renderer::{space::TuningSpace, tuning::objective::Objective};

use super::answers::{SERVICE, entrants};
use super::figures::{boxes, break_even, curve};
use super::judge::{BreakEven, Verdict};
use super::markup::{self, card};
use super::summary::{Mean, Standing, mean_of, standings};
use super::{folds::Split, part_page, progress_figures, record::Record};
use crate::converge::bootstrap::in_brackets;

/// More of other programs than this on average, and times are called disturbed.
const OTHER_CORES: f64 = 0.25;

const STYLE: &str = "\
:root{color-scheme:light dark;--paper:#fbfaf7;--card:#fff;--ink:#1d1f24;--soft:#5c616b;--line:#dcdad4;--warn:#fff0c9}\
@media(prefers-color-scheme:dark){:root{--paper:#16181c;--card:#1f2228;--ink:#e9e7e2;--soft:#a4a8b1;--line:#3a3e46;--warn:#4a3d14}}\
*{box-sizing:border-box}body{margin:0;background:var(--paper);color:var(--ink);font:1rem/1.55 system-ui,sans-serif}\
main{max-width:64rem;margin:0 auto;padding:1.2rem .8rem 4rem}h1{line-height:1.2;text-wrap:balance}h2{margin:2.6rem 0 .4rem}h3{margin:1.6rem 0 .3rem}\
p,li{max-width:46rem}.soft{color:var(--soft);font-size:.9rem}.warn{background:var(--warn);padding:.6rem .8rem;border-radius:.4rem}\
.card{background:var(--card);border:1px solid var(--line);border-radius:.5rem;padding:.5rem;min-width:0;margin:.6rem 0}\
table{border-collapse:collapse;width:100%;font-size:.86rem;font-variant-numeric:tabular-nums}\
th,td{padding:.25rem .35rem;text-align:right;border-bottom:1px solid var(--line)}th:first-child,td:first-child{text-align:left}\
th{color:var(--soft);font-weight:600}svg{display:block;width:100%;height:auto}code{font-size:.88em;overflow-wrap:anywhere}\
@media(max-width:600px){svg{font-size:17px}table,tbody,tr,td{display:block}tr{border-bottom:1px solid var(--line);padding:.4rem 0}\
tr:first-child{display:none}td{border:0;text-align:left;padding:.05rem 0}td:first-child{font-weight:650}td[data-l]::before{content:attr(data-l)\": \";color:var(--soft)}}";

/// The predictors on the first page, fixed beforehand: the paper's two and the service's own choice.
const FIRST_PAGE: [(&str, &str); 4] = [
    ("nearest_neighbour", "the paper's nearest neighbour"),
    ("rbf_greedy_gq", "the paper's RBF model"),
    ("auto", "the predictor that the service chooses by itself"),
    (SERVICE, "the service as it answers"),
];

#[derive(Clone, Debug)]
pub(crate) struct Report<'a> {
    pub(crate) record: &'a Record,
    pub(crate) space: &'a TuningSpace,
    pub(crate) complete: usize,
    pub(crate) verdicts: &'a [Verdict],
}

impl Report<'_> {
    fn scenes(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.record.searches.iter().map(|one| one.place.scene.as_str()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Warnings before any figure: that recording was stopped, and that the machine had other work.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut all = Vec::new();
        let expected = self.scenes().len() * self.record.conditions.cameras as usize;
        if self.complete < expected {
            all.push(format!(
                "Recording was stopped: {} of {expected} cameras are complete, and only they count here.",
                self.complete
            ));
        }
        let mut other: Vec<f64> =
            self.record.searches.iter().filter_map(|search| search.other_cores).collect();
        other.sort_by(f64::total_cmp);
        if let Some(median) = other.get(other.len() / 2).filter(|median| **median > OTHER_CORES) {
            all.push(format!(
                "The machine had other work: {median:.1} cores at the median of all searches. Take times for rough."
            ));
        }
        if self.record.programs.len() > 1 {
            let versions: Vec<&str> = self.record.programs.iter().map(String::as_str).collect();
            all.push(format!("Versions {} of the program measured parts of this.", versions.join(", ")));
        }
        for verdict in self.verdicts.iter().filter(|verdict| !verdict.unmeasured.is_empty()) {
            let names: Vec<&str> = verdict.unmeasured.keys().map(String::as_str).collect();
            all.push(format!(
                "Left out for {} time, because some of their answers were not measured: {}. `evaluate verify` measures them.",
                verdict.objective.name(),
                names.join("; ")
            ));
        }
        all
    }

    /// The first page in words, one sentence each.
    pub(crate) fn words(&self) -> Vec<String> {
        let mut all = Vec::new();
        for verdict in self.verdicts {
            let (name, all_standings) = (verdict.objective.name(), standings(verdict));
            let over_default =
                mean_of(&verdict.grounds.iter().map(|ground| ground.search_over_default).collect::<Vec<_>>());
            let over_fixed = mean_of(&verdict.search_over_fixed);
            all.push(format!(
                "For {name} time, a search of {} iterations found what is {over_default} times as fast as the recommended default and \
                 {over_fixed} times as fast as the best fixed configuration of the other scenes.",
                self.record.conditions.iterations
            ));
            for (split, (entrant, who)) in [Split::Random, Split::Scene]
                .into_iter()
                .flat_map(|split| FIRST_PAGE.map(|predictor| (split, predictor)))
            {
                let Some(one) = overall(&all_standings, split, entrant) else { continue };
                all.push(format!(
                    "On {}, {who} reached {} of the speed of what a search finds there, saved {} of the search's \
                     overhead, and was {} times as fast as the best fixed configuration.",
                    split.words(),
                    percent(one.of_roofline),
                    saved(one.overhead_reduction),
                    one.over_fixed
                ));
            }
        }
        all
    }
}

/// An entrant over all scenes.
fn overall<'a>(all: &'a [Standing], split: Split, entrant: &str) -> Option<&'a Standing> {
    all.iter().find(|one| one.split == split && one.scene.is_none() && one.entrant == entrant)
}

/// A share of an overhead; a dash where there was none to save.
fn saved(share: Option<f64>) -> String {
    share.map_or("–".to_owned(), |share| format!("{:.1} %", share * 100.0))
}

fn percent(mean: Mean) -> String {
    let percent = |share: f64| format!("{:.1}", share * 100.0);
    format!("{} %{}", percent(mean.mean), in_brackets(mean.interval, percent))
}

pub(crate) fn html(report: &Report<'_>) -> String {
    let conditions = &report.record.conditions;
    let [width, height] = conditions.size;
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>What tuning gains</title><style>{STYLE}</style></head><body><main>\n<h1>What tuning gains, and what predicting saves</h1>\n"
    );
    for warning in report.warnings() {
        let _ = write!(page, "<p class=\"warn\">{}</p>", escaped(&warning));
    }
    page += "<ul>";
    for sentence in report.words() {
        let _ = write!(page, "<li>{}</li>", escaped(&sentence));
    }
    let software: Vec<String> =
        conditions.machine.software.iter().map(|(name, version)| format!("{name} {version}")).collect();
    let _ = write!(
        page,
        "</ul><p class=\"soft\">{} scenes ({}), {} cameras of each at most, searches of {} iterations in the {} space; {width}×{height} pixels, \
         {} bounces, {} threads; {}, {}; {}. Means are geometric; intervals of 95 % are drawn by resampling cameras.</p>",
        report.scenes().len(),
        escaped(&report.scenes().join(", ")),
        conditions.cameras,
        conditions.iterations,
        conditions.space,
        conditions.bounces,
        if conditions.threads == 0 { "all".to_owned() } else { conditions.threads.to_string() },
        escaped(&conditions.machine.cpu_model),
        escaped(&conditions.machine.isa),
        escaped(&software.join(", "))
    );
    for verdict in report.verdicts {
        objective(&mut page, verdict);
        page += &progress_figures::progress(report.record, verdict);
    }
    page += &progress_figures::two_objectives(report.record).unwrap_or_default();
    page += &part_page::html(report.record, report.space);
    // A figure and its unit stay on one line.
    page = page.replace(" %", "\u{a0}%");
    page + "<h2>How to read this</h2><p>The roofline is the best configuration that the search found at a camera, measured again in the \
            same rounds as the answers, the default and the best fixed configuration; the best of many single measurements is partly luck, and stands \
            beside it as the paper has it. Overhead is \
            the time of as many frames as the search had iterations, less their time with the best known configuration. The search has broken even \
            once its iterations, and frames with its best from then on, have taken less time than frames with the prediction. \
            Boxes go from quartile to quartile, whiskers from the 5th to the 95th percentile; beyond the axis they end at its edge.</p>\
            </main></body></html>\n"
}

fn objective(page: &mut String, verdict: &Verdict) {
    let title = match verdict.objective {
        Objective::Render => "Render time: one build serves many frames",
        Objective::Error => "Time to an error",
        Objective::Motion => "Frames in motion",
        Objective::Auto(_) => "Trees that serve some frames",
        Objective::Total => "Build and render time: every frame pays for its build",
    };
    let _ = write!(page, "<h2>{title}</h2>");
    let failed: usize = verdict.grounds.iter().map(|ground| ground.failed).sum();
    let _ = write!(
        page,
        "<p class=\"soft\">{} searches; {failed} of their iterations could not be built and count for nothing; {} answers could not be built \
         where they were given and are left out. Best fixed configuration over all cameras: <code>{}</code></p>",
        verdict.grounds.len(),
        verdict.infeasible,
        escaped(verdict.fixed.as_deref().unwrap_or("none ran everywhere"))
    );
    let (names, all) = (entrants(), standings(verdict));
    for split in [Split::Random, Split::Scene] {
        if all.iter().all(|one| one.split != split) {
            continue;
        }
        let _ = write!(page, "<h3>On {}</h3>", split.words());
        *page += &table(&names, &all, split);
        let label = "times as fast as the search (Figures 12, 15)";
        *page += &card(&boxes(verdict, split, &names, |row| row.over_search, label));
        let label = "speed over that of the roofline (Figures 13, 16)";
        *page += &card(&boxes(verdict, split, &names, |row| row.of_roofline, label));
        *page += &card(&break_even(verdict, split, &names));
    }
    // The camera whose search cost most beyond its best shows the shape.
    let shown = verdict.rows.iter().filter(|row| row.split == Split::Random && row.entrant == names[0]);
    if let Some(row) = shown.max_by(|a, b| a.search_overhead_ms.total_cmp(&b.search_overhead_ms))
        && let Some(ground) = verdict.grounds.iter().find(|ground| ground.place == row.place)
    {
        let _ = write!(
            page,
            "<h3>One search beside its prediction (Figure 11)</h3><p class=\"soft\">{}, camera {}, where the search cost most beyond its best: \
             each iteration, dashed the best of them measured again, and in green what {} answered.</p>{}",
            escaped(&row.place.scene),
            row.place.camera,
            names[0],
            card(&curve(ground, row.predicted_ms))
        );
    }
}

fn table(names: &[String], all: &[Standing], split: Split) -> String {
    let heads = [
        "",
        "of the roofline",
        "least",
        "different answers",
        "as the paper has it",
        "over search",
        "over default",
        "over best fixed",
        "overhead saved",
        "break-even, median",
        "never",
        "late",
    ];
    let row = |name: &String| {
        let one = overall(all, split, name)?;
        Some(vec![
            name.clone(),
            percent(one.of_roofline),
            format!("{:.1} %", one.of_roofline_least * 100.0),
            format!("{} of {}", one.distinct, one.answers),
            format!("{:.1} %", one.of_roofline_once.mean * 100.0),
            format!("{:.2}", one.over_search.mean),
            format!("{:.2}", one.over_default.mean),
            format!("{:.2}", one.over_fixed.mean),
            saved(one.overhead_reduction),
            one.break_even.median.map_or("–".to_owned(), |median| format!("{median:.0}")),
            one.break_even.never.to_string(),
            one.break_even.late.to_string(),
        ])
    };
    markup::table(&heads, &names.iter().filter_map(row).collect::<Vec<_>>())
}

/// The results from the record, as CSV: file names and contents.
pub(crate) fn tables(report: &Report<'_>) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    for verdict in report.verdicts {
        let name = verdict.objective.name();
        files.insert(format!("progress-{name}.csv"), progress_figures::table(report.record, verdict));
        let mut rows = String::from(
            "split,fold,entrant,scene,camera,predicted_ms,over_search,of_roofline,of_roofline_once,over_default,over_fixed,break_even,\
             search_overhead_ms,prediction_overhead_ms\n",
        );
        for row in &verdict.rows {
            let break_even = match row.break_even {
                BreakEven::At(at) => format!("{at:.1}"),
                BreakEven::Late => "late".to_owned(),
                BreakEven::Never => "never".to_owned(),
            };
            let _ = writeln!(
                rows,
                "{:?},{},\"{}\",{},{},{:.4},{:.5},{:.5},{:.5},{:.5},{:.5},{break_even},{:.3},{:.3}",
                row.split,
                row.fold,
                row.entrant,
                row.place.scene,
                row.place.camera,
                row.predicted_ms,
                row.over_search,
                row.of_roofline,
                row.of_roofline_once,
                row.over_default,
                row.over_fixed,
                row.search_overhead_ms,
                row.prediction_overhead_ms,
            );
        }
        files.insert(format!("answers-{name}.csv"), rows);
    }
    files
}
