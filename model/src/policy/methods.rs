//! The searches, predictors and operations that a policy can name. The first two are those of `registry`, and
//! `auto`.

use crate::words::{Word, words};

/// A method of the registry, or `auto`.
#[derive(Clone, Copy, Debug)]
pub struct RegisteredMethod<T> {
    /// The method.
    pub method: T,
    /// Its number on the wire, never 0.
    pub number: i32,
    about: &'static [&'static str],
}

impl<T> RegisteredMethod<T> {
    /// Its description, in a sentence or two of plain text.
    pub fn about(&self) -> String {
        self.about.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ")
    }
}

/// The methods of the registry: [`SearchMethod`] and [`PredictorMethod`].
pub trait Method: Word {
    /// Every method: `auto`, then the rows of the registry in their order.
    const REGISTERED: &'static [RegisteredMethod<Self>];
    /// Methods of earlier versions, by their numbers on the wire and their words. `auto` has taken their
    /// place: policies that name one are read so.
    const RETIRED: &'static [(i32, &'static str)];
}

/// Makes an enum from the rows of the registry, with `auto` before them.
macro_rules! define_methods {
    (
        $(#[$meta:meta])*
        $name:ident, $(#[doc = $auto_about:literal])+ auto = $auto_number:literal,
        retired { $($retired_number:literal $retired:literal)* }
        $($(#[doc = $about:literal])+ $method:ident = $number:literal, $word:literal, $module:ident::$type:ident::$make:ident;)+
    ) => {
        words! {
            $(#[$meta])*
            #[derive(Default)]
            pub enum $name {
                $(#[doc = $auto_about])+
                #[default]
                Auto = "auto" $(| $retired)*,
                $($(#[doc = $about])+ $method = $word,)+
            }
        }

        impl Method for $name {
            const REGISTERED: &'static [RegisteredMethod<Self>] = &[
                RegisteredMethod { method: $name::Auto, number: $auto_number, about: &[$($auto_about),+] },
                $(RegisteredMethod { method: $name::$method, number: $number, about: &[$($about),+] },)+
            ];
            const RETIRED: &'static [(i32, &'static str)] = &[$(($retired_number, $retired),)*];
        }

        impl $name {
            /// The name in reasons.
            pub fn name(self) -> &'static str {
                self.word()
            }
        }
    };
}

macro_rules! define_searches {
    ($($rows:tt)+) => {
        define_methods! {
            /// Searches inside one state.
            SearchMethod,
            /// The search that the daemon's version recommends for every study; today `model`.
            auto = 5,
            retired {}
            $($rows)+
        }
    };
}

macro_rules! define_predictors {
    ($($rows:tt)+) => {
        define_methods! {
            /// Predictors across states.
            #[derive(PartialOrd, Ord)]
            PredictorMethod,
            /// The `contextual` one, unless another errs much less in this study, tested on trials before it
            /// learns from them.
            auto = 3,
            retired { 4 "weighted_neighbours" 5 "gaussian_greedy_gq" 6 "least_squares" }
            $($rows)+
        }
    };
}

crate::search_methods!(define_searches);
crate::predictor_methods!(define_predictors);

words! {
    /// The operation of a study: how it uses its knowledge.
    #[derive(Default)]
    pub enum Operation {
        /// Explores, exploits and learns.
        #[default]
        Tune = "tune",
        /// Neither explores nor learns: answers do not change. Infeasible configurations are still learnt.
        Freeze = "freeze",
        /// Every client gets the default configuration; the reason holds the answer of the policy. Reports
        /// are learnt.
        Shadow = "shadow",
    }
}
