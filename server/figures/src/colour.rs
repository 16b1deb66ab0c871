//! The palette of Okabe and Ito (2008), whose colours stay distinct under deuteranopia, and a scale between
//! two of them.

use std::fmt;

/// A colour that is legible on white and on black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Colour {
    /// That of the text around the figure.
    Ink,
    /// For what stands in the background.
    Grey,
    /// Also the best end of a scale.
    Blue,
    /// Also the worst end of a scale.
    Vermilion,
    /// Bluish green.
    Green,
    /// Reddish purple.
    Purple,
    /// Orange.
    Amber,
    /// Light blue.
    Sky,
    /// A place from the best (0, blue) over grey to the worst (1, vermilion); others are the nearest end.
    Scale(f64),
}

impl Colour {
    /// Colours of series that are equals, in order.
    const SERIES: [Self; 7] =
        [Self::Blue, Self::Vermilion, Self::Green, Self::Purple, Self::Amber, Self::Sky, Self::Ink];

    /// How many series differ in colour.
    pub const COUNT: usize = Self::SERIES.len();

    /// The colour of a series by its number; they begin again after [`Self::COUNT`].
    pub fn of(index: usize) -> Self {
        Self::SERIES[index % Self::COUNT]
    }

    /// Red, green and blue, 0 to 255; `None` for the page's own.
    fn rgb(self) -> Option<[u8; 3]> {
        Some(match self {
            Self::Ink => return None,
            Self::Grey => [128, 132, 138],
            Self::Blue => [0, 114, 178],
            Self::Vermilion => [213, 94, 0],
            Self::Green => [0, 158, 115],
            Self::Purple => [204, 121, 167],
            Self::Amber => [230, 159, 0],
            Self::Sky => [86, 180, 233],
            Self::Scale(place) => {
                let place = if place.is_nan() { 0.5 } else { place.clamp(0.0, 1.0) };
                let end = if place < 0.5 { Self::Blue } else { Self::Vermilion };
                // As much of the end as the place is far from the middle, which is grey.
                let share = (2.0 * place - 1.0).abs();
                let mixed = |part: u8| (176.0 + share * (f64::from(part) - 176.0)).round() as u8;
                end.rgb()?.map(mixed)
            }
        })
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.rgb() {
            None => to.write_str("currentColor"),
            Some([red, green, blue]) => write!(to, "#{red:02x}{green:02x}{blue:02x}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(part: u8) -> f64 {
        let share = f64::from(part) / 255.0;
        if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
    }

    /// As who lacks green cones sees it (Machado, Oliveira and Fernandes, 2009).
    fn under_deuteranopia(rgb: [u8; 3]) -> [f64; 3] {
        let rows =
            [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]];
        rows.map(|row| {
            let light: f64 = row.iter().zip(rgb).map(|(weight, part)| weight * linear(part)).sum();
            let light = light.clamp(0.0, 1.0);
            255.0 * if light <= 0.0031308 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
        })
    }

    #[test]
    fn series_are_told_apart_under_deuteranopia_and_on_both_grounds() {
        let all: Vec<[u8; 3]> = Colour::SERIES.iter().filter_map(|one| one.rgb()).collect();
        assert_eq!(all.len(), 6);
        for (index, one) in all.iter().enumerate() {
            let luminance: f64 =
                [0.2126, 0.7152, 0.0722].iter().zip(one).map(|(weight, part)| weight * linear(*part)).sum();
            let contrasts = [1.05 / (luminance + 0.05), (luminance + 0.05) / 0.0596];
            assert!(contrasts.iter().all(|contrast| *contrast > 2.2), "{one:?}: {contrasts:?}");
            for other in &all[..index] {
                let [a, b] = [*one, *other].map(under_deuteranopia);
                let squared: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
                assert!(squared.sqrt() > 50.0, "{one:?} looks like {other:?}");
            }
        }
    }

    #[test]
    fn a_scale_runs_from_the_best_to_the_worst() {
        let shown = [-1.0, 0.5, f64::NAN, 2.0].map(|place| Colour::Scale(place).to_string());
        assert_eq!(shown, ["#0072b2", "#b0b0b0", "#b0b0b0", "#d55e00"]);
        assert_eq!(Colour::of(Colour::COUNT), Colour::of(0));
    }
}
