//! Every predictor, in one table.
//!
//! A predictor is a file with a type that implements [`Predictor`] and is plain data through serde, and one row here. What
//! it is called on the command line, on the wire and in stored rows is the name of its method
//! (`treewright_model::policy::PredictorMethod`), which the row names; the compiler points at a method without a row.

use std::ops::{Deref, DerefMut};

use serde::{Deserialize, Serialize};

use super::{Contextual, LeastSquares, Nearest, Predictor, Rbf, Shape, Weighted};
use crate::policy::PredictorMethod;
use crate::space::Space;

/// What a predictor is made from.
#[derive(Clone, Copy, Debug)]
pub(super) struct PredictorSetup<'a> {
    /// The study's parameters.
    pub(super) space: &'a Space,
    /// How many indicators a state has.
    pub(super) indicators: usize,
    /// The study's seed, from which centres and choices are drawn.
    pub(super) seed: u64,
    /// The places of indicators that are left out of features.
    pub(super) omitted: &'a [usize],
}

macro_rules! predictors {
    ($($(#[doc = $about:literal])+ $method:ident($predictor:ty) = $make:expr,)+) => {
        /// One of the predictors, as it is stored. All that can be done with it are the methods of [`Predictor`].
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub(super) enum AnyPredictor {
            $($(#[doc = $about])+ $method($predictor),)+
        }

        impl AnyPredictor {
            /// A predictor that has learnt nothing. `None` for `auto`, which is the choice among all of them.
            pub(super) fn new(method: PredictorMethod, setup: PredictorSetup<'_>) -> Option<Self> {
                match method {
                    $(PredictorMethod::$method => {
                        let make: fn(PredictorSetup<'_>) -> $predictor = $make;
                        Some(AnyPredictor::$method(make(setup)))
                    })+
                    PredictorMethod::Auto => None,
                }
            }

            /// Which predictor it is; never `auto`.
            pub(super) fn method(&self) -> PredictorMethod {
                match self {
                    $(AnyPredictor::$method(_) => PredictorMethod::$method,)+
                }
            }
        }

        impl Deref for AnyPredictor {
            type Target = dyn Predictor;

            fn deref(&self) -> &Self::Target {
                match self {
                    $(AnyPredictor::$method(predictor) => predictor,)+
                }
            }
        }

        impl DerefMut for AnyPredictor {
            fn deref_mut(&mut self) -> &mut Self::Target {
                match self {
                    $(AnyPredictor::$method(predictor) => predictor,)+
                }
            }
        }

        /// Whether predictors of a method [learn](Predictor::learn): all others answer from the tables of the states.
        pub(super) fn learns(method: PredictorMethod) -> bool {
            match method {
                $(PredictorMethod::$method => <$predictor as Predictor>::learns(),)+
                PredictorMethod::Auto => true,
            }
        }

        /// All methods that are predictors of their own, in the order of the table: the first is preferred among equals.
        pub const METHODS: &[PredictorMethod] = &[$(PredictorMethod::$method,)+];
    };
}

predictors! {
    /// A Gaussian process over states and configurations; see `contextual`.
    Contextual(Contextual) = |s| Contextual::new(s.space, s.indicators, s.seed),
    /// The best over the nearest states, weighted by distance; see `nearest`.
    WeightedNeighbours(Weighted) = |_| Weighted,
    /// The best of the nearest state; see `nearest`.
    NearestNeighbour(Nearest) = |_| Nearest,
    /// Radial basis functions by recursive least squares; see `rbf`.
    LeastSquares(LeastSquares) =
        |s| LeastSquares::new(s.space.dimension(), s.indicators, s.seed, s.omitted),
    /// Radial basis functions by Greedy-GQ, as the paper prints them; see `rbf`.
    RbfGreedyGq(Rbf) = |s| Rbf::new(Shape::Printed, s.space.dimension(), s.indicators, s.seed, s.omitted),
    /// The same with Gaussians; see `rbf`.
    GaussianGreedyGq(Rbf) = |s| Rbf::new(Shape::Gaussian, s.space.dimension(), s.indicators, s.seed, s.omitted),
}
