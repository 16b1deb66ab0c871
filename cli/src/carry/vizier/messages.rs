//! The parts of OSS Vizier's `study.proto` that mean something here.

use prost::Message;

/// `Trial.State` of a trial with a final measurement, and of one that could not be used.
pub(super) const SUCCEEDED: i32 = 4;
pub(super) const INFEASIBLE: i32 = 5;
/// `MetricSpec.GoalType`.
pub(super) const MAXIMIZE: i32 = 1;
pub(super) const MINIMIZE: i32 = 2;
/// `ParameterSpec.ScaleType`.
pub(super) const LOG: i32 = 2;

/// Messages with some of their fields: the tag of each, its name, its type, and its kind in the encoding.
macro_rules! messages {
    ($($(#[$about:meta])* $name:ident { $($tag:tt $field:ident: $type:ty as $($kind:ident)+;)* })+) => {
        $(
            $(#[$about])*
            #[derive(Clone, PartialEq, Message)]
            pub(super) struct $name {
                $(#[prost($($kind,)+ tag = $tag)] pub(super) $field: $type,)*
            }
        )+
    };
}

messages! {
    Study {
        "3" spec: Option<StudySpec> as message optional;
    }
    StudySpec {
        "1" metrics: Vec<MetricSpec> as message repeated;
        "2" parameters: Vec<ParameterSpec> as message repeated;
    }
    MetricSpec {
        "1" id: String as string;
        "2" goal: i32 as int32;
    }
    ParameterSpec {
        "1" id: String as string;
        "2" double: Option<Doubles> as message optional;
        "3" integer: Option<Integers> as message optional;
        "4" categorical: Option<Categories> as message optional;
        "5" discrete: Option<Discrete> as message optional;
        "6" scale: i32 as int32;
        "10" children: Vec<Child> as message repeated;
    }
    Doubles {
        "1" min: f64 as double;
        "2" max: f64 as double;
        "3" default: Option<f64> as message optional;
    }
    Integers {
        "1" min: i64 as int64;
        "2" max: i64 as int64;
        "3" default: Option<i64> as message optional;
    }
    Categories {
        "1" values: Vec<String> as string repeated;
        "2" default: Option<String> as message optional;
    }
    Discrete {
        "1" values: Vec<f64> as double repeated;
        "2" default: Option<f64> as message optional;
    }
    /// A parameter that depends on another; only that there is one is read.
    Child {}
    Trial {
        "2" id: String as string;
        "3" state: i32 as int32;
        "4" parameters: Vec<Parameter> as message repeated;
        "5" measurement: Option<Measurement> as message optional;
        "9" client_id: String as string;
        "10" infeasible_reason: String as string;
    }
    Parameter {
        "1" id: String as string;
        "2" value: Option<prost_types::Value> as message optional;
    }
    Measurement {
        "3" metrics: Vec<MetricValue> as message repeated;
    }
    MetricValue {
        "1" id: String as string;
        "2" value: f64 as double;
    }
}
