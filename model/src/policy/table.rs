//! The one list of a policy's fields. The structs, their checks, the field mask, the command line and the
//! shown texts follow from it. So does the wire conversion (`treewright_proto::convert`), which does not
//! compile while this list and the proto's `message Policy` differ. Another field is one row here and one in
//! the proto.

/// Hands the table to another macro, as rows of `name: decided type | given type = default, unset "default in
/// words", in range, as "placeholder";` each with its documentation. The field `pinned`, whose type differs
/// from form to form, is not among the rows.
#[macro_export]
macro_rules! policy_table {
    ($apply:ident) => {
        $apply! {
            /// Probability of exploring when a client's state changes, 0 to 1 (paper section 6).
            ///
            /// The dice are thrown again whenever a client's stay in a state has doubled its length, and a
            /// stay of 3 / epsilon frames explores for certain, unless `dice_once` is set.
            epsilon: f64 | f64 = 0.2, unset "0.2", in Range::Within(0.0, 1.0), as "PROBABILITY";

            /// Search inside a state.
            search: SearchMethod | OpenEnum<SearchMethod> = SearchMethod::Auto, unset "auto", in Range::Any, as "METHOD";

            /// Predictor that answers when exploiting.
            predictor: PredictorMethod | OpenEnum<PredictorMethod> = PredictorMethod::Auto,
                unset "auto", in Range::Any, as "METHOD";

            /// Runs after which a state's search ends, repeats included, 1 to 100,000 (paper 7.1.1: 80).
            trials_per_state: u32 | u32 = 80, unset "80", in Range::Within(1.0, TRIALS_PER_STATE_MAX as f64), as "COUNT";

            /// How often one configuration is measured in one state before the search goes on, 1 to 100.
            replicates: u32 | u32 = 1, unset "1", in Range::Within(1.0, REPLICATES_MAX as f64), as "COUNT";

            /// Seconds that a lease lasts unless it is extended, 1 to 86,400.
            lease_s: u32 | u32 = 60, unset "60", in Range::Within(1.0, LEASE_S_MAX as f64), as "SECONDS";

            /// Number of visits to a state that halve epsilon there, 0 to 1,000,000; 0 leaves it constant.
            ///
            /// It is `epsilon h / (h + n)` after `n` visits, which never stops exploring and lets it become
            /// rare (Singh, Jaakkola, Littman and Szepesvári, "Convergence results for single-step on-policy
            /// reinforcement-learning algorithms", 2000).
            epsilon_halves_after: u32 | u32 = 0, unset "0", in Range::Within(0.0, EPSILON_HALVES_AFTER_MAX as f64), as "VISITS";

            /// Exploring may cost each client at most this share of its frame time in each session, 0 to 1.
            ///
            /// The guarantee needs clients that stop trials in time (`SuggestRequest.can_abort`).
            regret_budget: Option<f64> | f64 = None, unset "no limit", in Range::Within(0.0, 1.0), as "SHARE";

            /// Multiple of the reference's cost above which an exploring trial shall stop, above 1.
            abort_above: Option<f64> | f64 = None,
                unset "2 where a budget is kept, else 4 for clients that stop trials in time",
                in Range::Above(1.0, COST_FACTOR_MAX), as "FACTOR";

            /// Assumed worst cost of a trial of a client that cannot stop it, in multiples of the reference.
            ///
            /// Only counts where a budget is kept.
            worst_factor: f64 | f64 = 100.0, unset "100", in Range::Above(1.0, COST_FACTOR_MAX), as "FACTOR";

            /// Use of the study's knowledge: tune, freeze or shadow.
            operation: Operation | OpenEnum<Operation> = Operation::Tune, unset "tune", in Range::Any, as "OPERATION";

            /// Explore only where the expected gain pays for it within the expected stay.
            weigh_gain: bool | bool = false, unset "false", in Range::Any, as "BOOL";

            /// Every client explores until the state's search has ended, and exploits then. For programs that
            /// are tuned before they are used, so that trials cost nobody anything.
            ///
            /// The dice are not thrown, but an epsilon of 0 still means never. Studies without indicators,
            /// whose one state nobody ever leaves, are explored in this way whatever this field says.
            offline: bool | bool = false, unset "false", in Range::Any, as "BOOL";

            /// Number of trials at the start of each session of a client that are not learnt, 0 to 10,000.
            warm_up: u32 | u32 = 0, unset "0", in Range::Within(0.0, WARM_UP_MAX as f64), as "COUNT";

            /// A configuration that does clearly worse where it is exploited than another that was measured
            /// there gives way to it at once.
            roll_back: bool | bool = true, unset "true", in Range::Any, as "BOOL";

            /// Most rounds in which a state's best few configurations run against the default, once its
            /// search has ended, 0 to 100; 0 leaves that out.
            ///
            /// They add no configuration, so they do not count among `trials_per_state`. All run in the first
            /// ten rounds. Where the machine is noisy the best one goes on alone, until a gain of 2 % could
            /// be seen. A race ends as soon as one is proven better, or none can gain a noticeable amount any
            /// more.
            confirm_rounds: u32 | u32 = 40, unset "40", in Range::Within(0.0, CONFIRM_ROUNDS_MAX as f64), as "COUNT";

            /// The incumbent is measured again now and then while a state is searched, and costs are divided
            /// by how fast the client's machine is at the moment.
            track_speed: bool | bool = true, unset "true", in Range::Any, as "BOOL";

            /// The dice are thrown once for each visit of a client to a state, as in the paper, however long
            /// it stays.
            ///
            /// A client that never leaves its state may then never explore it: its first throw stands.
            dice_once: bool | bool = false, unset "false", in Range::Any, as "BOOL";
        }
    };
}
