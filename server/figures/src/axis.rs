//! Axes: ranges, scales and round ticks inside them.

/// A scale from one number to another with its title, which names the unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    title: String,
    low: f64,
    high: f64,
    is_logarithmic: bool,
    /// Whether its marks are whole numbers.
    is_count: bool,
    /// Marks with names in the place of numbers.
    labels: Option<Vec<(f64, String)>>,
}

impl Axis {
    /// Even steps from one number to another.
    pub fn between(title: &str, low: f64, high: f64) -> Self {
        Self { title: title.to_owned(), low, high, is_logarithmic: false, is_count: false, labels: None }
    }

    /// Even steps of whole numbers, such as those of trials.
    pub fn counts(title: &str, low: f64, high: f64) -> Self {
        Self { is_count: true, ..Self::between(title, low, high) }
    }

    /// Even steps, with a little room at both ends, but not below 0 where no value is. Numbers that are not
    /// finite do not count.
    pub fn linear(title: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = ends(values);
        let size = high.abs().max(low.abs());
        let room = if high > low { 0.04 * (high - low) } else { 0.01 * size + f64::from(size == 0.0) };
        Self::between(title, if low >= 0.0 { (low - room).max(0.0) } else { low - room }, high + room)
    }

    /// Even steps over all values but the largest one in 25, and over other numbers: a few bad values do not
    /// flatten the rest. They are drawn at the edge and marked.
    pub fn robust(
        title: &str,
        values: impl IntoIterator<Item = f64>,
        others: impl IntoIterator<Item = f64>,
    ) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        sorted.truncate(sorted.len() - sorted.len() / 25);
        Self::linear(title, sorted.into_iter().chain(others))
    }

    /// Even factors; values that are not above 0 have no place.
    pub fn logarithmic(title: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = ends(values.into_iter().filter(|value| *value > 0.0));
        let (low, high) = if low > 0.0 { (low, high) } else { (1.0, 10.0) };
        let room = (high / low).powf(0.04).max(1.02);
        Self { is_logarithmic: true, ..Self::between(title, low / room, high * room) }
    }

    /// Logarithmic where all values are above 0 and the largest is over ten times the smallest, else even.
    pub fn fitting(title: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.into_iter().collect();
        let (low, high) = ends(values.iter().copied());
        if low > 0.0 && high > 10.0 * low {
            Self::logarithmic(title, values)
        } else {
            Self::linear(title, values)
        }
    }

    /// Even steps with names instead of numbers, each at its place.
    pub fn labelled(title: &str, [low, high]: [f64; 2], labels: Vec<(f64, String)>) -> Self {
        Self { labels: Some(labels), ..Self::between(title, low, high) }
    }

    /// From 0 to 1 with the names of both ends.
    pub fn ends(title: &str, low: &str, high: &str) -> Self {
        Self::labelled(title, [0.0, 1.0], vec![(0.0, low.to_owned()), (1.0, high.to_owned())])
    }

    /// Rows from the top: that of name `n` is from `n` to `n + 1`.
    pub fn rows<S: AsRef<str>>(names: &[S]) -> Self {
        let labels = names.iter().enumerate().map(|(row, name)| (row as f64 + 0.5, name.as_ref().to_owned()));
        Self::labelled("", [names.len() as f64, 0.0], labels.collect())
    }

    pub(crate) fn heading(&self) -> String {
        format!("{}{}", self.title, if self.is_logarithmic { ", logarithmic" } else { "" })
    }

    /// Whether differences look larger than they are.
    pub(crate) fn begins_above_zero(&self) -> bool {
        !self.is_logarithmic && self.labels.is_none() && self.low > 0.0
    }

    pub(crate) fn is_rows(&self) -> bool {
        self.low > self.high
    }

    pub(crate) fn range(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    fn beyond(&self, value: f64) -> f64 {
        match self.is_logarithmic {
            true => (value.max(f64::MIN_POSITIVE) / self.low).ln() / (self.high / self.low).ln(),
            false => (value - self.low) / (self.high - self.low),
        }
    }

    /// Where a value lies, from 0 to 1; beyond the ends it is at them.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let share = self.beyond(value);
        if share.is_nan() { 0.5 } else { share.clamp(0.0, 1.0) }
    }

    pub(crate) fn holds(&self, value: f64) -> bool {
        let share = self.beyond(value);
        share.is_nan() || (-1e-9..=1.0 + 1e-9).contains(&share)
    }

    /// Where lines are drawn, with their labels.
    pub(crate) fn marks(&self) -> Vec<(f64, String)> {
        if let Some(labels) = &self.labels {
            return labels.clone();
        }
        if self.is_logarithmic {
            return self.factors().into_iter().map(|tick| (tick, number(tick))).collect();
        }
        let step = nice_step(self.high - self.low).max(if self.is_count { 1.0 } else { 0.0 });
        if !(step.is_finite() && step > 0.0) {
            return vec![(self.low, number(self.low))];
        }
        let digits = (-(step.log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
        let first = (self.low / step - 1e-9).ceil();
        let ticks = (0..12).map(|index| (first + f64::from(index)) * step + 0.0);
        let inside = ticks.take_while(|tick| *tick <= self.high + 1e-9 * step);
        let is_plain = step >= 1e-6 && self.high.abs().max(self.low.abs()) < 1e7;
        inside.map(|tick| (tick, if is_plain { format!("{tick:.digits$}") } else { number(tick) })).collect()
    }

    /// 1, 2 and 5 of each decade; every whole one where few of them would be inside, and fewer where many.
    fn factors(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let units: &[f64] = match decades {
            ..0.6 => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
            ..2.5 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let exponents = (first..=last).step_by((decades / 8.0).ceil().max(1.0) as usize);
        let all = exponents.flat_map(|exponent| units.iter().map(move |unit| unit * 10_f64.powi(exponent)));
        all.filter(|tick| self.holds(*tick)).collect()
    }
}

fn ends(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), one| (low.min(one), high.max(one)));
    if low > high { (0.0, 1.0) } else { (low, high) }
}

/// A step of 1, 2 or 5 times a power of ten that parts a length into three to six.
fn nice_step(length: f64) -> f64 {
    let power = 10_f64.powf((length / 5.0).log10().floor());
    power * [1.0, 2.0, 5.0].into_iter().find(|unit| unit * power >= length / 5.0 * 0.999_999).unwrap_or(10.0)
}

/// Three significant digits, without those that say nothing.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e7).contains(&size) {
        let text = format!("{value:.2e}").replace(".00e", "e");
        return if text.contains('.') { text.replace("0e", "e") } else { text };
    }
    let digits = (2.0 - size.max(1e-9).log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(axis: &Axis) -> Vec<f64> {
        axis.marks().into_iter().map(|(tick, _)| tick).collect()
    }

    #[test]
    fn ticks_are_round_and_within_their_range() {
        let labels = |low, high| -> Vec<String> {
            Axis::between("", low, high).marks().into_iter().map(|(_, label)| label).collect()
        };
        assert_eq!(labels(0.0, 10.0), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(0.3, 1.7), ["0.5", "1.0", "1.5"]);
        assert_eq!(labels(-30.0, 170.0), ["0", "50", "100", "150"]);
        assert_eq!(labels(7.0, 7.0), ["7"]);
        let counts = |low, high| ticks(&Axis::counts("", low, high));
        assert_eq!((counts(1.0, 3.0), counts(7.0, 7.0)), (vec![1.0, 2.0, 3.0], vec![7.0]));
        assert_eq!(counts(0.0, 1000.0), ticks(&Axis::between("", 0.0, 1000.0)));
        assert_eq!(labels(5.0, 5.001), ["5.0000", "5.0002", "5.0004", "5.0006", "5.0008", "5.0010"]);
        for (low, high) in [(1e-9, 3e-9), (5.0, 5.001), (-1e12, 2e12), (99.0, 101.0), (0.0, 3e300)] {
            let axis = Axis::between("", low, high);
            let count = ticks(&axis).iter().filter(|tick| axis.holds(**tick)).count();
            assert!((3..=6).contains(&count) && count == ticks(&axis).len(), "{:?}", axis.marks());
        }
    }

    #[test]
    fn factors_are_within_the_decades() {
        assert_eq!(ticks(&Axis::logarithmic("", [1.5, 30.0])), [2.0, 5.0, 10.0, 20.0]);
        assert_eq!(ticks(&Axis::logarithmic("", [24.0, 48.0])), [30.0, 40.0]);
        assert_eq!(ticks(&Axis::logarithmic("", [1e-3, 1e4])).len(), 8);
        assert!((4..=10).contains(&ticks(&Axis::logarithmic("", [1e-9, 1e9])).len()));
        assert!(ticks(&Axis::logarithmic("", [0.0, -1.0])).len() > 1, "an empty figure has axes too");
        assert!(Axis::fitting("", [1.0, 30.0]).is_logarithmic);
        assert!(
            !Axis::fitting("", [1.0, 9.0]).is_logarithmic && !Axis::fitting("", [0.0, 9.0]).is_logarithmic
        );
    }

    #[test]
    fn ranges_hold_what_counts() {
        let axis = Axis::linear("", [3.0, f64::NAN, 5.0]);
        assert!(axis.holds(3.0) && axis.holds(5.0) && !axis.holds(0.0) && !axis.holds(6.0));
        assert_eq!((axis.share(-5.0), axis.share(50.0), axis.share(f64::NAN)), (0.0, 1.0, 0.5));
        assert_eq!(Axis::linear("", [0.5, 100.0]).low, 0.0, "nothing is below zero");
        assert!(Axis::linear("", [-1.0, 2.0]).low < -1.0);
        for one in [&[7.0][..], &[], &[0.0, 0.0]] {
            let axis = Axis::linear("", one.iter().copied());
            assert!(axis.low < axis.high && !axis.marks().is_empty(), "{axis:?}");
        }
        let values = || (0..25).map(|index| if index == 7 { 1e6 } else { f64::from(index) });
        let axis = Axis::robust("", values(), [40.0]);
        assert!(axis.holds(24.0) && axis.holds(40.0) && !axis.holds(1e6));
    }

    #[test]
    fn rows_begin_at_the_top_and_headings_say_what_misleads() {
        let axis = Axis::rows(&["first", "second"]);
        assert_eq!((axis.share(0.0), axis.share(0.5), axis.share(2.0)), (1.0, 0.75, 0.0));
        assert!(Axis::between("ms", 3.0, 4.0).begins_above_zero() && !axis.begins_above_zero());
        let factors = Axis::logarithmic("s", [1.0]);
        assert!(factors.heading() == "s, logarithmic" && !factors.begins_above_zero());
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.05, 1200.0, 2.0, -0.0, 2e7, -5e-5, 1.5e-9, 1.234e10, f64::INFINITY].map(number);
        assert_eq!(shown, ["0.05", "1200", "2", "0", "2e7", "-5e-5", "1.5e-9", "1.23e10", "inf"]);
    }
}
