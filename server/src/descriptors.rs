//! The limit of open files and sockets of the process, and its shares.
//!
//! A daemon with more connections than descriptors can accept no further one, not even an orchestrator's
//! probe. So the limit is raised as far as possible (getrlimit(2): a process may raise its soft limit to the
//! hard one). Connections get the descriptors that the database and the other listeners do not need.

use nix::sys::resource::{Resource, getrlimit, setrlimit};

use crate::connections::ConnectionLimits;
use crate::limits;

/// The number of descriptors that each part of the daemon may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DescriptorShares {
    /// Connections of clients.
    pub connections: usize,
    /// Connections of each listener for pages.
    pub pages: usize,
}

impl DescriptorShares {
    /// Shares out `descriptors` descriptors.
    pub fn of(descriptors: usize) -> Self {
        let pages = (descriptors / 16).clamp(1, limits::PAGES_CONNECTIONS);
        let others = limits::DESCRIPTORS_OWN + 2 * pages;
        let connections = descriptors.saturating_sub(others).max(limits::CONNECTIONS_MIN);
        let all = others + connections;
        assert!(connections == limits::CONNECTIONS_MIN || all <= descriptors, "{all} of {descriptors}");
        Self { connections, pages }
    }

    /// The limits of connections, with the requested numbers, if any.
    pub fn limits(&self, total: Option<usize>, per_address: Option<usize>) -> ConnectionLimits {
        let total = total.unwrap_or(limits::CONNECTIONS).min(self.connections);
        assert!(total > 0, "of {} connections none is to be had", self.connections);
        let per_address = per_address.unwrap_or((total / 2).max(1));
        ConnectionLimits::new(total, per_address)
    }
}

/// Raises the limit as far as the system allows. Returns the new limit and the old one.
pub fn raise() -> std::io::Result<(usize, usize)> {
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE)?;
    let count = |limit: u64| usize::try_from(limit).unwrap_or(usize::MAX);
    if soft >= hard {
        return Ok((count(soft), count(soft)));
    }
    match setrlimit(Resource::RLIMIT_NOFILE, hard, hard) {
        Ok(()) => Ok((count(hard), count(soft))),
        // Some systems have a lower limit for a process's files than this one.
        Err(_) => Ok((count(soft), count(soft))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_there_is_suffices_for_all_parts_together() {
        for descriptors in [256, 300, 1024, 4096, 65_536, 1 << 20] {
            let shares = DescriptorShares::of(descriptors);
            let connections = shares.limits(None, None);
            let all = limits::DESCRIPTORS_OWN + connections.total + 2 * shares.pages;
            assert!(all <= descriptors, "{descriptors}: {all}");
            assert!(connections.total >= descriptors.min(limits::CONNECTIONS) / 4, "{connections:?}");
        }
        assert_eq!(DescriptorShares::of(10).connections, limits::CONNECTIONS_MIN);
        let farm = DescriptorShares::of(1 << 20).limits(None, None);
        assert!(farm.total >= 3 * 5000 && farm.per_address >= 5000, "a farm of 5,000 behind one gateway");
    }

    #[test]
    fn what_is_asked_for_is_had_as_far_as_there_are_descriptors() {
        let shares = DescriptorShares::of(1024);
        assert_eq!(shares.limits(Some(100), Some(7)).total, 100);
        assert_eq!(shares.limits(Some(100), Some(7)).per_address, 7);
        assert_eq!(shares.limits(Some(9000), None).total, shares.connections);
    }

    #[test]
    fn the_soft_limit_becomes_the_hard_one() {
        let (now, _) = raise().expect("Linux");
        let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE).expect("Linux");
        assert_eq!((soft as usize, soft), (now, hard));
    }
}
