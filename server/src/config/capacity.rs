//! The options that limit the daemon's load.

use clap::Args;

use crate::admission::AdmissionLimits;
use crate::connections::ConnectionLimits;
use crate::descriptors::DescriptorShares;
use crate::limits::{
    CONNECTIONS_MAX, REQUESTS_IN_FLIGHT, REQUESTS_IN_FLIGHT_MAX, TUNE_STREAMS, TUNE_STREAMS_MAX,
};

/// Limits of requests and connections. A request above one is refused with RESOURCE_EXHAUSTED, or the
/// connection is closed.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Capacity")]
pub struct CapacityConfig {
    /// Maximum number of connections; 16384 by default. Each needs a file descriptor, so `ulimit -Hn` limits
    /// them too. At most half of them may be ones without an authorised request. When all are taken, one of
    /// these makes room for the next, or else one that is idle. It is the oldest of the address that has most
    /// of them.
    #[arg(long, env = "TREEWRIGHT_MAX_CONNECTIONS", value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=CONNECTIONS_MAX as i64))]
    pub max_connections: Option<u32>,

    /// Maximum number of connections from one address; half of all by default. Clients behind one gateway
    /// share an address.
    #[arg(long, env = "TREEWRIGHT_MAX_CONNECTIONS_PER_ADDRESS", value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=CONNECTIONS_MAX as i64))]
    pub max_connections_per_address: Option<u32>,

    /// Maximum number of open Tune streams.
    #[arg(long, env = "TREEWRIGHT_MAX_STREAMS", default_value_t = TUNE_STREAMS as u32, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=TUNE_STREAMS_MAX as i64))]
    pub max_streams: u32,

    /// Maximum number of requests and Tune frames processed at once.
    #[arg(long, env = "TREEWRIGHT_MAX_REQUESTS", default_value_t = REQUESTS_IN_FLIGHT as u32, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=REQUESTS_IN_FLIGHT_MAX as i64))]
    pub max_requests: u32,
}

impl CapacityConfig {
    /// The limits of connections within these shares of descriptors.
    pub fn connections(&self, shares: &DescriptorShares) -> ConnectionLimits {
        let count = |asked: Option<u32>| asked.map(|asked| asked as usize);
        shares.limits(count(self.max_connections), count(self.max_connections_per_address))
    }

    /// The most work at once.
    pub fn admission(&self) -> AdmissionLimits {
        AdmissionLimits { requests: self.max_requests as usize, streams: self.max_streams as usize }
    }
}
