//! Between the wire and the tuner. `from_proto` reads requests and names a wrong field, `to_proto` and
//! `insight` write answers, `names` reads and writes resource names, `study_update` reads update masks.
//! Types of the model become messages in `treewright_proto::convert`.

pub mod from_proto;
mod insight;
pub mod names;
pub mod policy_differences;
pub mod study_update;
pub mod to_proto;
