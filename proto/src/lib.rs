//! Wire types of the Treewright tuning service. The meaning of every message is in the comments of
//! `proto/treewright/v1/*.proto`. The code in `generated` is made from them (`tests/generated.rs`), and
//! [`convert`] turns messages into the types of `treewright-model` and back, the only place that uses both.

pub mod convert;

/// Package `treewright.v1`.
#[allow(clippy::doc_markdown, clippy::large_enum_variant, missing_docs)]
pub mod v1 {
    include!("generated/treewright.v1.rs");
}

/// The encoded `FileDescriptorSet` of the package, for gRPC reflection.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("generated/descriptor.bin");
