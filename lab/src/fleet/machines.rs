//! Emulated machines: an instruction set, a number of threads and a size of pictures on one processor.

use std::fmt;

use serde::{Deserialize, Serialize};
use treewright_client::Fingerprint;
use treewright_render_cli::arguments::Size;

use crate::leave_scene_out::suite::Context;

/// A machine as far as one processor can stand in for it. Its name is `ISA:THREADS@WIDTHxHEIGHT`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Machine {
    /// The widest instruction set in use, which is also its group.
    pub(crate) isa: String,
    threads: usize,
    /// Pixels across and down.
    size: [u32; 2],
}

impl fmt::Display for Machine {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}", self.isa, self.context())
    }
}

impl Machine {
    pub(crate) fn all(isas: &[String], threads: &[usize], sizes: &[Size]) -> Vec<Self> {
        let of = |isa: &String, threads: usize, size: &Size| Self { isa: isa.clone(), threads, size: size.0 };
        let pairs = isas.iter().flat_map(|isa| threads.iter().map(move |threads| (isa, *threads)));
        pairs.flat_map(|(isa, threads)| sizes.iter().map(move |size| of(isa, threads, size))).collect()
    }

    pub(crate) fn context(&self) -> Context {
        Context { threads: self.threads, size: Size(self.size) }
    }

    /// How it introduces itself to a daemon: the group in the processor's name, since machines of one
    /// processor are a group, and the machine in the instruction set's, since all fields mean one machine.
    pub(crate) fn fingerprint(&self, processor: &Fingerprint) -> Fingerprint {
        Fingerprint {
            cpu_model: format!("{}, {}", processor.cpu_model, self.isa),
            isa: self.to_string(),
            threads: u32::try_from(self.threads).unwrap_or(u32::MAX),
            software: processor.software.clone(),
        }
    }
}

/// Whose measurements a predictor knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Level {
    Nothing,
    Node,
    /// The measurements of its group, its own among them.
    Group,
    Fleet,
}

impl Level {
    /// Each knows at least what the one before it knows.
    pub(crate) const ALL: [Self; 4] = [Self::Nothing, Self::Node, Self::Group, Self::Fleet];

    /// Whether the predictor of `own` knows the measurements of `other`.
    pub(crate) fn knows(self, own: &Machine, other: &Machine) -> bool {
        match self {
            Self::Nothing => false,
            Self::Node => own == other,
            Self::Group => own.isa == other.isa,
            Self::Fleet => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn levels_and_daemons_see_a_machine_in_its_group_in_the_fleet() {
        let sizes = ["32x24", "64x48", "96x72"].map(|size| size.parse().expect("it is a size"));
        let all = Machine::all(&["sse2".to_owned(), "avx2".to_owned()], &[1, 2], &sizes);
        let own = &all[4];
        assert_eq!((all.len(), own.to_string().as_str()), (12, "sse2:2@64x48"));
        let known = |level: Level| all.iter().filter(|other| level.knows(own, other)).count();
        assert_eq!(Level::ALL.map(known), [0, 1, 6, 12]);
        let processor = Fingerprint { cpu_model: "one".to_owned(), ..Fingerprint::default() };
        let prints: Vec<Fingerprint> = all.iter().map(|one| one.fingerprint(&processor)).collect();
        let distinct = |of: fn(&Fingerprint) -> &str| prints.iter().map(of).collect::<BTreeSet<_>>().len();
        assert_eq!((distinct(|print| &print.cpu_model), distinct(|print| &print.isa)), (2, 12));
    }
}
