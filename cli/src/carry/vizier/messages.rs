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

#[derive(Clone, PartialEq, Message)]
pub(super) struct Study {
    #[prost(message, optional, tag = "3")]
    pub(super) spec: Option<StudySpec>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct StudySpec {
    #[prost(message, repeated, tag = "1")]
    pub(super) metrics: Vec<MetricSpec>,
    #[prost(message, repeated, tag = "2")]
    pub(super) parameters: Vec<ParameterSpec>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct MetricSpec {
    #[prost(string, tag = "1")]
    pub(super) id: String,
    #[prost(int32, tag = "2")]
    pub(super) goal: i32,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct ParameterSpec {
    #[prost(string, tag = "1")]
    pub(super) id: String,
    #[prost(message, optional, tag = "2")]
    pub(super) double: Option<Doubles>,
    #[prost(message, optional, tag = "3")]
    pub(super) integer: Option<Integers>,
    #[prost(message, optional, tag = "4")]
    pub(super) categorical: Option<Categories>,
    #[prost(message, optional, tag = "5")]
    pub(super) discrete: Option<Discrete>,
    #[prost(int32, tag = "6")]
    pub(super) scale: i32,
    #[prost(message, repeated, tag = "10")]
    pub(super) children: Vec<Child>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Doubles {
    #[prost(double, tag = "1")]
    pub(super) min: f64,
    #[prost(double, tag = "2")]
    pub(super) max: f64,
    #[prost(message, optional, tag = "3")]
    pub(super) default: Option<f64>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Integers {
    #[prost(int64, tag = "1")]
    pub(super) min: i64,
    #[prost(int64, tag = "2")]
    pub(super) max: i64,
    #[prost(message, optional, tag = "3")]
    pub(super) default: Option<i64>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Categories {
    #[prost(string, repeated, tag = "1")]
    pub(super) values: Vec<String>,
    #[prost(message, optional, tag = "2")]
    pub(super) default: Option<String>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Discrete {
    #[prost(double, repeated, tag = "1")]
    pub(super) values: Vec<f64>,
    #[prost(message, optional, tag = "2")]
    pub(super) default: Option<f64>,
}

/// A parameter that depends on another; only that there is one is read.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Child {}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Trial {
    #[prost(string, tag = "2")]
    pub(super) id: String,
    #[prost(int32, tag = "3")]
    pub(super) state: i32,
    #[prost(message, repeated, tag = "4")]
    pub(super) parameters: Vec<Parameter>,
    #[prost(message, optional, tag = "5")]
    pub(super) measurement: Option<Measurement>,
    #[prost(string, tag = "9")]
    pub(super) client_id: String,
    #[prost(string, tag = "10")]
    pub(super) infeasible_reason: String,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Parameter {
    #[prost(string, tag = "1")]
    pub(super) id: String,
    #[prost(message, optional, tag = "2")]
    pub(super) value: Option<prost_types::Value>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct Measurement {
    #[prost(message, repeated, tag = "3")]
    pub(super) metrics: Vec<MetricValue>,
}

#[derive(Clone, PartialEq, Message)]
pub(super) struct MetricValue {
    #[prost(string, tag = "1")]
    pub(super) id: String,
    #[prost(double, tag = "2")]
    pub(super) value: f64,
}
