//! The predictors of the registry (`model/src/policy/registry.rs`) as one type.
//!
//! A row there names a type of a module here, which implements [`Predictor`] and is plain data through serde,
//! and its constructor. All else follows.

use std::ops::{Deref, DerefMut};

use serde::{Deserialize, Serialize};

use super::{Predictor, PredictorSetup};
use crate::policy::PredictorMethod;

macro_rules! predictors {
    ($($(#[doc = $about:literal])+ $method:ident = $number:literal, $word:literal, $module:ident::$predictor:ident::$make:ident;)+) => {
        /// One of the predictors, as it is stored. It has the methods of [`Predictor`].
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub(super) enum AnyPredictor {
            $($(#[doc = $about])+ $method(super::$module::$predictor),)+
        }

        impl AnyPredictor {
            /// A predictor that has learnt nothing. `None` for `auto`, which is the choice among all of them.
            pub(super) fn new(method: PredictorMethod, setup: PredictorSetup<'_>) -> Option<Self> {
                match method {
                    $(PredictorMethod::$method => {
                        Some(AnyPredictor::$method(super::$module::$predictor::$make(setup)))
                    })+
                    PredictorMethod::Auto => None,
                }
            }

            /// The predictor's method; never `auto`.
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

        /// Whether predictors of a method [learn](Predictor::learn): all others answer from the tables of the
        /// states.
        pub(super) fn learns(method: PredictorMethod) -> bool {
            match method {
                $(PredictorMethod::$method => <super::$module::$predictor as Predictor>::learns(),)+
                PredictorMethod::Auto => true,
            }
        }

        /// All methods that are predictors of their own, in the order of the registry: the first is preferred
        /// among equals.
        pub const METHODS: &[PredictorMethod] = &[$(PredictorMethod::$method,)+];
    };
}

treewright_model::predictor_methods!(predictors);
