//! Instruction sets that kernels, and callers' loops, are compiled for, as the build script chooses.

use std::sync::OnceLock;

/// The widest one that this process may use, where that is not the best available.
static WIDEST: OnceLock<Isa> = OnceLock::new();

/// An instruction set with kernels of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Isa {
    /// Plain Rust, with the instructions of the compiler's baseline.
    Scalar,
    /// AVX2 and fused multiply-add.
    Avx2,
    /// AVX-512 with 128 and 256 bit vectors.
    Avx512,
}

impl Isa {
    /// All of them, the plainest first.
    pub const ALL: [Self; 3] = [Self::Scalar, Self::Avx2, Self::Avx512];

    /// The best one that is available and not [ruled out](Self::limit).
    pub fn detect() -> Self {
        let widest = WIDEST.get().copied().unwrap_or(Self::Avx512);
        let allowed = Self::ALL.into_iter().rev().filter(|isa| *isa <= widest);
        allowed.into_iter().find(|isa| isa.is_available()).unwrap_or(Self::Scalar)
    }

    /// Keeps this process, Embree's kernels included, from anything wider. Call it before the first device is
    /// opened. `false` where the set is not available, or another one was named before.
    pub fn limit(self) -> bool {
        self.is_available() && *WIDEST.get_or_init(|| self) == self
    }

    /// The set that this process is [kept to](Self::limit), if any.
    pub fn widest() -> Option<Self> {
        WIDEST.get().copied()
    }

    /// The name in fingerprints and for Embree.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "sse2",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Whether kernels are compiled for it and this processor has it.
    pub fn is_available(self) -> bool {
        let is_compiled = match self {
            Self::Scalar => cfg!(kernels_scalar),
            Self::Avx2 => cfg!(kernels_avx2),
            Self::Avx512 => cfg!(kernels_avx512),
        };
        is_compiled && self.is_there()
    }

    /// Whether this processor has it.
    fn is_there(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        macro_rules! has {
            ($($feature:tt)*) => { true $(&& is_x86_feature_detected!($feature))* };
        }
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => has!("avx2" "fma" "bmi1" "bmi2" "lzcnt" "popcnt"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => Self::Avx2.is_there() && has!("avx512f" "avx512vl" "avx512dq" "avx512bw"),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }
}

/// Loops worth compiling for each instruction set, with equal results: nothing is fused or reordered.
pub trait Work {
    /// The result of the loop.
    type Output;

    /// Does it. To be marked `#[inline(always)]`, and all it calls, or it stays compiled for the baseline.
    fn run(self) -> Self::Output;
}

impl Isa {
    /// Does some work with this instruction set, or with the baseline's where it is not available.
    #[inline]
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self {
            #[cfg(all(target_arch = "x86_64", kernels_avx512))]
            // SAFETY: the processor has what the function is compiled for.
            Self::Avx512 if self.is_available() => unsafe { run_with_avx512(work) },
            #[cfg(all(target_arch = "x86_64", kernels_avx2))]
            // SAFETY: the processor has what the function is compiled for.
            Self::Avx2 if self.is_available() => unsafe { run_with_avx2(work) },
            _ => work.run(),
        }
    }
}

#[cfg(all(target_arch = "x86_64", kernels_avx512))]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn run_with_avx512<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(all(target_arch = "x86_64", kernels_avx2))]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn run_with_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_gives_the_same_bits_with_every_instruction_set() {
        struct Norms<'a>(&'a [[f32; 3]]);
        impl Work for Norms<'_> {
            type Output = Vec<u32>;

            #[inline(always)]
            fn run(self) -> Vec<u32> {
                self.0.iter().map(|[x, y, z]| (1.0 / (x * x + y * y + z * z).sqrt()).to_bits()).collect()
            }
        }
        let vectors: Vec<[f32; 3]> =
            (0..1000).map(|n| [0.1, 1.7, -3.3].map(|step| step * n as f32 + 0.01)).collect();
        let expected = Norms(&vectors).run();
        for isa in Isa::ALL {
            assert_eq!(isa.run(Norms(&vectors)), expected, "{isa:?}");
        }
    }

    #[test]
    fn names_tell_them_apart() {
        let names: std::collections::BTreeSet<&str> = Isa::ALL.into_iter().map(Isa::name).collect();
        assert_eq!(names.len(), Isa::ALL.len());
    }

    #[test]
    fn the_plain_one_is_always_there_and_the_best_one_is_chosen() {
        assert!(Isa::Scalar.is_available());
        let best = Isa::detect();
        assert!(best.is_available());
        assert!(Isa::ALL.into_iter().filter(|isa| isa.is_available()).all(|isa| isa <= best));
    }
}
