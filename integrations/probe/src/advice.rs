//! Conclusions from the measurements: shares of processor time, the largest gain of a better tree or build
//! (Amdahl 1967), and advice.

use std::fmt::Write as _;

use crate::findings::Findings;

/// Below this gain of the whole program nothing is worth the work.
const WORTH_IT: f64 = 1.10;
/// Best speedup per ray of a tuned tree over Embree's default on the measured scenes.
const FASTER_TREE: f64 = 1.5;
/// Speedup of Embree's builds at quality low over medium.
const FASTER_BUILD: f64 = 3.0;
/// `RTC_SCENE_FLAG_ROBUST`.
const ROBUST: u32 = 1 << 2;

/// The speedup of the whole when a share of it becomes faster by a factor.
fn amdahl(share: f64, faster: f64) -> f64 {
    1.0 / (1.0 - share + share / faster)
}

impl Findings {
    /// Share of the processor time, at most 0.99, because estimates can add up to more than all of it.
    fn share(&self, ms: f64) -> f64 {
        if self.cpu_ms > 0.0 { (ms / self.cpu_ms).clamp(0.0, 0.99) } else { 0.0 }
    }

    fn traversal(&self) -> f64 {
        self.share(self.closest.total_ms + self.occluded.total_ms)
    }

    fn build(&self) -> f64 {
        self.share(self.build_cpu_ms)
    }

    /// A table and the advice.
    pub(crate) fn report(&self) -> String {
        let mut text = String::new();
        let mut line = |words: String| {
            let _ = writeln!(text, "{words}");
        };
        line(format!("Embree: {}, device \"{}\"", self.embree, self.device));
        line(format!(
            "asked for: {}{}, {} primitives in buffers, by {} thread(s)",
            self.quality_words(),
            if self.flags & ROBUST != 0 { ", robust" } else { "" },
            self.primitives,
            self.threads
        ));
        line(format!("{:<22}{:>12}{:>14}{:>12}{:>9}", "", "calls", "rays", "ms", "share"));
        for (name, one) in [("closest hit", &self.closest), ("occlusion", &self.occluded)] {
            let share = 100.0 * self.share(one.total_ms);
            line(format!("{name:<22}{:>12}{:>14}{:>12.1}{share:>8.1}%", one.calls, one.rays, one.total_ms));
        }
        let share = 100.0 * self.build();
        line(format!(
            "{:<22}{:>12}{:>14}{:>12.1}{share:>8.1}%",
            "builds", self.builds, "", self.build_cpu_ms
        ));
        line(format!("{:<22}{:>12}{:>14}{:>12.1}", "processor time in all", "", "", self.cpu_ms));
        line(format!(
            "at most, with rays that cost nothing: {:.2} x",
            amdahl(self.traversal(), f64::INFINITY)
        ));
        line(format!("with a tree {FASTER_TREE} x as fast: {:.2} x", amdahl(self.traversal(), FASTER_TREE)));
        line(format!("with builds {FASTER_BUILD} x as fast: {:.2} x", amdahl(self.build(), FASTER_BUILD)));
        line(format!("advice: {}", self.advice()));
        text
    }

    fn quality_words(&self) -> String {
        let names = ["low", "medium", "high", "refit"];
        let asked =
            (0..4).filter(|bit| self.qualities >> bit & 1 == 1).map(|bit| names[bit]).collect::<Vec<_>>();
        if asked.is_empty() {
            "quality medium (the default)".into()
        } else {
            format!("quality {}", asked.join(", "))
        }
    }

    /// Integrate, set a switch, or leave it.
    pub(crate) fn advice(&self) -> String {
        let (tree, build) = (amdahl(self.traversal(), FASTER_TREE), amdahl(self.build(), FASTER_BUILD));
        let robust = self.flags & ROBUST != 0;
        let mut words = if tree.max(build) < WORTH_IT {
            format!(
                "leave it. Neither a better tree nor a faster build makes this program {WORTH_IT:.2} x as fast; the time goes elsewhere."
            )
        } else if build > tree {
            "integrate, or set quality low where scenes are built often (try it: --set quality=low): builds are what costs most here."
                .into()
        } else {
            "integrate: rays are what costs most here, and which tree serves them best depends on the scene."
                .into()
        };
        if robust {
            words.push_str(" It asks for robust, with which Embree takes quality high for medium; without it (--set robust=off) rays are faster, and pixels at edges change.");
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::findings::Queries;

    fn found(traversal_ms: f64, build_ms: f64, flags: u32) -> Findings {
        let closest = Queries { calls: 10, rays: 10, total_ms: traversal_ms };
        Findings { closest, build_cpu_ms: build_ms, cpu_ms: 100.0, flags, ..Findings::default() }
    }

    #[test]
    fn the_law_by_hand() {
        assert_eq!(amdahl(0.5, f64::INFINITY), 2.0);
        assert_eq!(amdahl(0.5, 2.0), 4.0 / 3.0);
        assert_eq!(amdahl(0.0, 9.0), 1.0);
    }

    #[test]
    fn advice_follows_the_shares() {
        assert!(found(12.0, 3.0, 0).advice().starts_with("leave it"));
        assert!(found(60.0, 3.0, 0).advice().starts_with("integrate: rays"));
        assert!(found(20.0, 60.0, 0).advice().starts_with("integrate, or set quality low"));
        assert!(found(12.0, 3.0, ROBUST).advice().contains("robust"));
    }

    #[test]
    fn nothing_measured_is_no_division_by_nothing() {
        let report = Findings::default().report();
        assert!(report.contains("1.00 x") && !report.contains("NaN"), "{report}");
        assert!(found(1000.0, 0.0, 0).report().contains(" 99.0%"), "more than all is nearly all");
    }
}
