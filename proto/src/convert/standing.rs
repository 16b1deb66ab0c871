//! The standing of answers.

use treewright_model::standing::{Confirmation, ConfirmationStage, Gain, Standing};
use treewright_model::words::OpenEnum;

use super::{WireEnum, signed, unsigned};
use crate::v1;

/// The standing of a state's answer.
pub fn standing_to_wire(standing: &Standing) -> v1::Standing {
    let Confirmation { stage, rounds, rounds_max, measurements, gain } = standing.confirmation;
    v1::Standing {
        cost: standing.cost,
        cost_low: standing.cost_low,
        cost_high: standing.cost_high,
        gain: standing.gain.map(gain_to_wire),
        nothing_better: standing.nothing_better,
        confirmation: Some(v1::Confirmation {
            stage: stage.number(),
            rounds: signed(rounds),
            rounds_max: signed(rounds_max),
            measurements: signed(measurements),
            gain: gain.map(gain_to_wire),
        }),
        disturbances: signed(standing.disturbances),
        gain_at_most: standing.gain_at_most,
    }
}

/// Reads the standing of a state's answer. A stage of a newer version counts as one in progress.
pub fn standing_from_wire(wire: v1::Standing) -> Standing {
    let confirmation = wire.confirmation.unwrap_or_default();
    let stage = ConfirmationStage::from_number(confirmation.stage).and_then(OpenEnum::known);
    Standing {
        cost: wire.cost,
        cost_low: wire.cost_low,
        cost_high: wire.cost_high,
        gain: wire.gain.map(gain_from_wire),
        nothing_better: wire.nothing_better,
        confirmation: Confirmation {
            stage: stage.unwrap_or(ConfirmationStage::Racing),
            rounds: unsigned(confirmation.rounds),
            rounds_max: unsigned(confirmation.rounds_max),
            measurements: unsigned(confirmation.measurements),
            gain: confirmation.gain.map(gain_from_wire),
        },
        disturbances: unsigned(wire.disturbances),
        gain_at_most: wire.gain_at_most,
    }
}

fn gain_to_wire(gain: Gain) -> v1::Gain {
    let Gain { share, low, high, probability_better } = gain;
    v1::Gain { share, low, high, probability_better }
}

fn gain_from_wire(gain: v1::Gain) -> Gain {
    let v1::Gain { share, low, high, probability_better } = gain;
    Gain { share, low, high, probability_better }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_proven_survives_the_wire() {
        let gain = Some(Gain { share: 0.1, low: Some(0.05), high: None, probability_better: Some(0.99) });
        let stage = ConfirmationStage::Better;
        let confirmation = Confirmation { stage, rounds: 7, rounds_max: 10, measurements: 19, gain };
        let standing = Standing {
            cost: 9.0,
            cost_low: 8.5,
            cost_high: 9.5,
            gain,
            nothing_better: false,
            confirmation,
            disturbances: 2,
            gain_at_most: Some(0.02),
        };
        assert_eq!(standing_from_wire(standing_to_wire(&standing)), standing);
        let mut newer = standing_to_wire(&standing);
        newer.confirmation.as_mut().expect("set").stage = 77;
        assert_eq!(standing_from_wire(newer).confirmation.stage, ConfirmationStage::Racing);
    }
}
