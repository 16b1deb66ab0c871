//! Between the wire and the domain: the only place that knows both. `from_proto` reads requests and names
//! the field that is wrong, `to_proto` writes answers, `names` reads and writes resource names, `policy`
//! reads policies and update masks.

pub mod from_proto;
mod insight;
pub mod names;
pub mod policy;
pub mod policy_differences;
pub mod to_proto;
