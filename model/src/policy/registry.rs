//! The registry of searches and predictors: one row for each, and the only list of them.
//!
//! A row has a method's description, its number on the wire, its word, and the constructor of its type. The
//! enums of this crate follow from the rows, and with them command lines, settings and their schema. In
//! `treewright-core`, which alone uses the first and the last column, the module, the storage and the choice
//! follow. In `treewright-proto` the conversion follows. A command writes the values and comments of the wire
//! contract (`proto/tests/generated.rs`).
//!
//! A released word or number never changes. Those of methods that are gone are retired beside `auto`, in
//! `methods`.

/// Hands the searches to another macro, as rows `NAME = number on the wire, "word",
/// module::Type::constructor;`, each with its description. The module is one of `treewright_core::search`;
/// the constructor takes a `SearchSetup`.
#[macro_export]
macro_rules! search_methods {
    ($apply:ident) => {
        $apply! {
            /// Latin hypercube start, then a stochastic Nelder-Mead after Chang (2012) (paper section 6).
            NelderMead = 1, "nelder_mead", nelder_mead::NelderMead::new;
            /// Latin hypercube designs, one after the other.
            LatinHypercube = 2, "latin_hypercube", latin_hypercube::LatinHypercubeSearch::new;
            /// Independent uniform samples.
            Random = 3, "random", random::RandomSearch::new;
            /// Gaussian processes and expected improvement: strong at 20 to 80 trials, in mixed and
            /// conditional spaces; also under noise and where many configurations cannot be run.
            Model = 4, "model", model::ModelSearch::new;
        }
    };
}

/// Hands the predictors to another macro, as [`search_methods!`](crate::search_methods) does. The module is
/// one of `treewright_core::predict`; the constructor takes a `PredictorSetup`. Among predictors that err
/// alike the first is preferred.
#[macro_export]
macro_rules! predictor_methods {
    ($apply:ident) => {
        $apply! {
            /// A Gaussian process over indicators and parameters together, which also proposes what to
            /// explore; useful where every input is met only once.
            Contextual = 7, "contextual", contextual::Contextual::new;
            /// Best configuration of the nearest known state (paper section 6.1).
            NearestNeighbour = 1, "nearest_neighbour", nearest::Nearest::new;
            /// Radial basis functions trained by Greedy-GQ with gamma = 0 (paper section 6.2, as printed).
            RbfGreedyGq = 2, "rbf_greedy_gq", rbf::Rbf::for_study;
        }
    };
}
