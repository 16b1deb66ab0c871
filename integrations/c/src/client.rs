//! The connection to a daemon.

use std::mem::MaybeUninit;

use treewright_client::blocking;

use crate::configuration::from_json;
use crate::edge::{ErrorOut, Text, guard, need, put};
use crate::error::Failure;
use crate::options::{Options, milliseconds};
use crate::spec::Spec;
use crate::study::Study;
use crate::suggestion::Suggestion;

/// A client. May be used by several threads at once.
#[derive(Debug)]
pub(crate) struct Client(pub(crate) blocking::Client);

exports! {
    fn tw_client_connect(url: Text, options: Option<&Options>; error) -> Option<Box<Client>> {
        let options = options.map_or_else(|| Ok(treewright_client::Options::new()), Options::finish)?;
        Ok(Client(blocking::Client::connect(url.read("the daemon's address")?, options)?))
    }

    fn tw_client_free(client: Client);

    fn tw_client_ping(client: Option<&Client>, ms: Option<&mut MaybeUninit<f64>>; error) -> bool {
        let took = need(client, "client")?.0.ping()?;
        put(ms, took.as_secs_f64() * 1e3);
        Ok(())
    }

    fn tw_client_flush(client: Option<&Client>, deadline_ms: f64; error) -> bool {
        let deadline = milliseconds(deadline_ms).map_err(Failure::invalid)?;
        Ok(need(client, "client")?.0.flush(deadline)?)
    }

    fn tw_client_count(client: Option<&Client>, which: i32) -> u64 {
        let body = || {
            let stats = need(client, "client")?.0.stats();
            Ok(match which {
                0 => stats.suggestions,
                1 => stats.fallbacks,
                2 => stats.unreported,
                3 => stats.sent,
                4 => stats.acknowledged,
                5 => stats.resent,
                6 => stats.refused,
                7 => stats.dropped,
                8 => stats.abandoned,
                9 => stats.queued,
                _ => 0,
            })
        };
        guard(ErrorOut::nowhere(), body).unwrap_or(0)
    }

    fn tw_client_study(client: Option<&Client>, id: Text, spec: Option<&Spec>; error) -> Option<Box<Study>> {
        let spec = need(spec, "specification")?.finish()?;
        Ok(Study(need(client, "client")?.0.study(id.read("the study's id")?, spec)?))
    }

    fn tw_client_existing_study(client: Option<&Client>, id: Text; error) -> Option<Box<Study>> {
        Ok(Study(need(client, "client")?.0.existing_study(id.read("the study's id")?)?))
    }

    fn tw_client_extend_lease(client: Option<&Client>, suggestion: Option<&mut Suggestion>; error) -> bool {
        let client = need(client, "client")?;
        Ok(client.0.extend_lease(&mut need(suggestion, "suggestion")?.inner)?)
    }
}

/// The effect of a change of a space; see the header.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(crate) struct ChangedSpace {
    revision: u32,
    kept_trials: i64,
    outside_trials: i64,
    given_back_trials: i64,
}

exports! {
    fn tw_client_change_space(
        client: Option<&Client>, id: Text, spec: Option<&Spec>, fixed_json: Text, only_try: bool,
        changed: Option<&mut MaybeUninit<ChangedSpace>>; error
    ) -> bool {
        let space = need(spec, "specification")?.space()?;
        let fixed = fixed_json.optional()?.map(from_json).transpose()?.unwrap_or_default();
        let client = &need(client, "client")?.0;
        let study = client.get_study(id.read("the study's id")?)?;
        let (name, revision) = (study.identified_name(), study.space_revision);
        let done = client.change_space(&name, revision, &space, &fixed, only_try)?;
        let done = ChangedSpace {
            revision: done.study.space_revision,
            kept_trials: done.kept_trials,
            outside_trials: done.outside_trials,
            given_back_trials: done.given_back_trials,
        };
        put(changed, done);
        Ok(())
    }

    fn tw_client_delete_study(client: Option<&Client>, id: Text; error) -> bool {
        Ok(need(client, "client")?.0.delete_study(id.read("the study's id")?)?)
    }
}
