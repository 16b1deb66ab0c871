//! The searches, predictors and operations that a policy can name.

use crate::words::{Word, words};

words! {
    /// Searches inside one state.
    #[derive(Default)]
    pub enum SearchMethod {
        /// The search that the daemon's version recommends, the same for every study; today [`SearchMethod::Model`].
        #[default]
        Auto = "auto",
        /// Latin hypercube start, then a stochastic Nelder-Mead after Chang (2012) (paper section 6).
        NelderMead = "nelder_mead",
        /// Latin hypercube designs, one after the other.
        LatinHypercube = "latin_hypercube",
        /// Independent uniform samples.
        Random = "random",
        /// Gaussian processes and expected improvement: strong at 20 to 80 trials, in mixed and conditional spaces; see
        /// `treewright_core::search::model`.
        Model = "model",
    }
}

words! {
    /// Predictors across states; see `treewright_core::predict`.
    #[derive(Default, PartialOrd, Ord)]
    pub enum PredictorMethod {
        /// Whichever of the others has the smallest error in this study, tested on every trial before learning from it.
        #[default]
        Auto = "auto",
        /// Best configuration of the nearest known state (paper section 6.1).
        NearestNeighbour = "nearest_neighbour",
        /// Best configuration over the eight nearest known states, weighted by distance.
        WeightedNeighbours = "weighted_neighbours",
        /// Radial basis functions trained by Greedy-GQ with gamma = 0 (paper section 6.2, as printed).
        RbfGreedyGq = "rbf_greedy_gq",
        /// Radial basis functions trained by Greedy-GQ that are Gaussians, as the paper's words have it.
        GaussianGreedyGq = "gaussian_greedy_gq",
        /// Radial basis functions fitted by recursive least squares, with models of their own for each kind of machine and
        /// each client.
        LeastSquares = "least_squares",
        /// A Gaussian process over indicators and parameters together, which also proposes what to explore.
        Contextual = "contextual",
    }
}

words! {
    /// What a study does with what it knows.
    #[derive(Default)]
    pub enum Operation {
        /// Explores, exploits and learns.
        #[default]
        Tune = "tune",
        /// Neither explores nor learns: answers stay what they are. That a configuration cannot be run is taken all
        /// the same.
        Freeze = "freeze",
        /// Every client gets the default configuration; what would have been answered stands in the reason. Reports
        /// are learnt.
        Shadow = "shadow",
    }
}

impl SearchMethod {
    /// The name that reasons carry.
    pub fn name(self) -> &'static str {
        self.word()
    }
}

impl PredictorMethod {
    /// The name that reasons carry.
    pub fn name(self) -> &'static str {
        self.word()
    }
}
