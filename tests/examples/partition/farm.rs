//! Renderers, their studies and shows, and the group of each study.

use std::cmp::Reverse;

/// Shows of a farm, and studies of a show.
const SHOWS: usize = 40;
const STUDIES_PER_SHOW: usize = 25;

/// The rule by which a study finds its group.
#[derive(Clone, Copy)]
pub(crate) enum Rule {
    /// By a hash of its id.
    HashOfStudy,
    /// By a hash of the prefix of its id: all studies of a show in one group.
    HashOfShow,
    /// Show by show, the largest first, each to the group that has the fewest renderers (Graham, "Bounds on
    /// multiprocessing timing anomalies", 1969).
    LargestFirst,
}

impl Rule {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::HashOfStudy => "hash of the study",
            Self::HashOfShow => "hash of the show",
            Self::LargestFirst => "shows, largest first",
        }
    }
}

/// The places of renderers and studies.
pub(crate) struct Farm {
    /// For each group, the study of each of its renderers.
    pub(crate) groups: Vec<Vec<usize>>,
}

impl Farm {
    pub(crate) fn new(renderers: usize, groups: usize, rule: Rule) -> Self {
        let shows = zipf(renderers, SHOWS);
        let studies: Vec<(usize, usize)> = shows
            .iter()
            .enumerate()
            .flat_map(|(show, &size)| {
                zipf(size, STUDIES_PER_SHOW).into_iter().map(move |renderers| (show, renderers))
            })
            .collect();
        let mut sizes = vec![0; groups];
        let mut of_show = vec![0; SHOWS];
        let mut order: Vec<usize> = (0..SHOWS).collect();
        order.sort_by_key(|&show| Reverse(shows[show]));
        for show in order {
            let least = (0..groups).min_by_key(|&group| sizes[group]).unwrap_or(0);
            sizes[least] += shows[show];
            of_show[show] = least;
        }
        let mut farm = Self { groups: vec![Vec::new(); groups] };
        for (study, (show, renderers)) in studies.into_iter().enumerate() {
            let group = match rule {
                Rule::HashOfStudy => hash(study as u64) as usize % groups,
                Rule::HashOfShow => hash(!(show as u64)) as usize % groups,
                Rule::LargestFirst => of_show[show],
            };
            farm.groups[group].extend(std::iter::repeat_n(study, renderers));
        }
        farm
    }
}

/// Splits a number into parts that fall as one over their rank; what rounding leaves goes to the first.
fn zipf(total: usize, parts: usize) -> Vec<usize> {
    let sum: f64 = (1..=parts).map(|rank| 1.0 / rank as f64).sum();
    let mut sizes: Vec<usize> =
        (1..=parts).map(|rank| (total as f64 / (rank as f64 * sum)) as usize).collect();
    sizes[0] += total - sizes.iter().sum::<usize>();
    sizes
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators",
/// 2014).
pub(crate) fn hash(number: u64) -> u64 {
    let mut mixed = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}
