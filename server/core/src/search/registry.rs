//! The searches of the registry (`model/src/policy/registry.rs`) as one type.
//!
//! A row there names a type of a module here, which implements [`Search`] and is plain data through serde,
//! and its constructor. All else follows.

use std::ops::{Deref, DerefMut};

use serde::{Deserialize, Serialize};

use super::{ModelSearch, Search, SearchSetup};
use crate::policy::SearchMethod;

/// The search that `auto` stands for in this version.
///
/// It is one search for all studies. For budgets of 20 to 80 trials it was best on the suites of
/// `docs/measurements/searches.md` for every kind of axes. The exception is one recorded landscape of trees, where
/// Nelder-Mead was level. Studies that ask for `auto` get another one when a later version recommends it.
const RECOMMENDED: SearchMethod = SearchMethod::Model;

const _: () = assert!(!matches!(RECOMMENDED, SearchMethod::Auto), "it would stand for itself");

/// The method itself, or the search that `auto` stands for.
pub fn resolved(method: SearchMethod) -> SearchMethod {
    if method == SearchMethod::Auto { RECOMMENDED } else { method }
}

macro_rules! searches {
    ($($(#[doc = $about:literal])+ $method:ident = $number:literal, $word:literal, $module:ident::$search:ident::$make:ident;)+) => {
        /// One of the searches, as it is stored. It has the methods of [`Search`].
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case", from = "Stored")]
        #[expect(clippy::large_enum_variant, reason = "nearly all searches are of the largest kind")]
        pub enum AnySearch {
            $($(#[doc = $about])+ $method(super::$module::$search),)+
        }

        /// A search as any version stored it.
        #[derive(Deserialize)]
        #[serde(rename_all = "snake_case")]
        enum Stored {
            $($method(super::$module::$search),)+
            /// `auto` was a search of its own that held the recommended one.
            Auto { model: ModelSearch },
        }

        impl From<Stored> for AnySearch {
            fn from(stored: Stored) -> Self {
                match stored {
                    $(Stored::$method(search) => AnySearch::$method(search),)+
                    Stored::Auto { model } => AnySearch::Model(model),
                }
            }
        }

        impl AnySearch {
            /// A fresh search.
            pub fn new(method: SearchMethod, setup: SearchSetup) -> Self {
                match method {
                    $(SearchMethod::$method => {
                        AnySearch::$method(super::$module::$search::$make(setup))
                    })+
                    SearchMethod::Auto => AnySearch::new(RECOMMENDED, setup),
                }
            }

            /// Whether it is a method's search, or the one that `auto` stands for.
            pub fn is_of(&self, method: SearchMethod) -> bool {
                self.method() == resolved(method)
            }

            /// The search's method; never `auto`.
            pub fn method(&self) -> SearchMethod {
                match self {
                    $(AnySearch::$method(_) => SearchMethod::$method,)+
                }
            }
        }

        impl Deref for AnySearch {
            type Target = dyn Search;

            fn deref(&self) -> &Self::Target {
                match self {
                    $(AnySearch::$method(search) => search,)+
                }
            }
        }

        impl DerefMut for AnySearch {
            fn deref_mut(&mut self) -> &mut Self::Target {
                match self {
                    $(AnySearch::$method(search) => search,)+
                }
            }
        }

        /// Whether searches of a method [follow](Search::follow) other states.
        pub fn hears_others(method: SearchMethod) -> bool {
            match method {
                $(SearchMethod::$method => <super::$module::$search as Search>::hears_others(),)+
                SearchMethod::Auto => hears_others(RECOMMENDED),
            }
        }

        /// All methods that are searches of their own, in the order of the table.
        #[cfg(test)]
        pub(crate) const METHODS: &[SearchMethod] = &[$(SearchMethod::$method,)+];
    };
}

treewright_model::search_methods!(searches);
