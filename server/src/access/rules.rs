//! The scope that each RPC needs, in one table. An RPC outside it is refused, so that a new one stays closed
//! until it has a row. A test compares the table with the wire contract.

use treewright_store::tokens::Scope;

/// The credential that a request needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// No credential: load balancers may ask whether the daemon serves.
    Nothing,
    /// A token with this scope, or a wider one.
    Scope(Scope),
}

/// An RPC, with its name for people and its credential.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccessRule {
    /// The path of the HTTP request.
    pub path: &'static str,
    /// The name in logs and metrics.
    pub rpc: &'static str,
    /// The credential that it needs.
    pub need: Need,
}

const READ: Need = Need::Scope(Scope::Read);
const TUNE: Need = Need::Scope(Scope::Tune);
const ADMIN: Need = Need::Scope(Scope::Admin);

const fn rule(path: &'static str, rpc: &'static str, need: Need) -> AccessRule {
    AccessRule { path, rpc, need }
}

/// The table.
pub const RULES: &[AccessRule] = &[
    rule("/treewright.v1.TuningService/GetStudy", "GetStudy", READ),
    rule("/treewright.v1.TuningService/ListStudies", "ListStudies", READ),
    rule("/treewright.v1.TuningService/Predict", "Predict", READ),
    rule("/treewright.v1.TuningService/GetTrial", "GetTrial", READ),
    rule("/treewright.v1.TuningService/QueryTrials", "QueryTrials", READ),
    rule("/treewright.v1.TuningService/GetBest", "GetBest", READ),
    rule("/treewright.v1.TuningService/CreateStudy", "CreateStudy", TUNE),
    rule("/treewright.v1.TuningService/UpdateStudy", "UpdateStudy", ADMIN),
    rule("/treewright.v1.TuningService/Suggest", "Suggest", TUNE),
    rule("/treewright.v1.TuningService/Report", "Report", TUNE),
    rule("/treewright.v1.TuningService/Tune", "Tune", TUNE),
    rule("/treewright.v1.TuningService/AbandonTrial", "AbandonTrial", TUNE),
    rule("/treewright.v1.TuningService/ExtendLease", "ExtendLease", TUNE),
    rule("/treewright.v1.TuningService/RenameStudy", "RenameStudy", ADMIN),
    rule("/treewright.v1.TuningService/ChangeSpace", "ChangeSpace", ADMIN),
    rule("/treewright.v1.TuningService/ExcludeTrial", "ExcludeTrial", ADMIN),
    rule("/treewright.v1.TuningService/DeleteStudy", "DeleteStudy", ADMIN),
    rule("/grpc.health.v1.Health/Check", "Health.Check", Need::Nothing),
    rule("/grpc.health.v1.Health/Watch", "Health.Watch", Need::Nothing),
    rule("/grpc.reflection.v1.ServerReflection/ServerReflectionInfo", "Reflection", READ),
    rule("/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", "Reflection", READ),
];

/// The rule for a path. Unknown paths need the widest scope, and are then answered UNIMPLEMENTED.
pub fn rule_for(path: &str) -> AccessRule {
    let known = RULES.iter().find(|rule| rule.path == path);
    known.copied().unwrap_or(AccessRule { path: "", rpc: "unknown", need: ADMIN })
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::*;

    #[test]
    fn every_rpc_of_the_contract_has_one_rule_and_no_rule_is_without_rpc() {
        let mut paths = std::collections::BTreeSet::new();
        for file in [treewright_proto::FILE_DESCRIPTOR_SET, tonic_health::pb::FILE_DESCRIPTOR_SET] {
            for file in prost_types::FileDescriptorSet::decode(file).expect("a descriptor").file {
                for service in &file.service {
                    for method in &service.method {
                        let path = format!("/{}.{}/{}", file.package(), service.name(), method.name());
                        assert_eq!(RULES.iter().filter(|rule| rule.path == path).count(), 1, "{path}");
                        paths.insert(path);
                    }
                }
            }
        }
        assert!(paths.len() > 10);
        for rule in RULES.iter().filter(|rule| rule.rpc != "Reflection") {
            assert!(paths.contains(rule.path), "{} is no RPC", rule.path);
        }
    }

    #[test]
    fn what_is_unknown_is_closed() {
        assert_eq!(rule_for("/treewright.v1.TuningService/Format").need, ADMIN);
        assert_eq!(rule_for("").rpc, "unknown");
    }
}
