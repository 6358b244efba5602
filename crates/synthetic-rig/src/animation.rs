//! The figure's motion: it walks on the spot, waves with its right hand and looks about.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use crate::body::joints;
use crate::skeleton::{BONE_COUNT, Bone, Pose, Skeleton};

/// How long one loop of the motion takes at natural speed, in seconds.
pub(crate) const PERIOD_SECS: f64 = 4.0;

/// Strides (left and right step) in one loop.
const STRIDES: f64 = 3.0;
/// Times that the hand waves in one loop.
const WAVES: f64 = 4.0;

/// The pose at `phase` (0 to 1) of the loop, with the lower foot on the ground.
pub(crate) fn pose(skeleton: &Skeleton, phase: f64) -> Pose {
    let turns = turns(phase);
    let sway = Vector3::x() * (-0.025 * sine(STRIDES * phase - 0.12));
    let floating = skeleton.pose(&turns, sway);
    let height = |bone: Bone, side: f64| {
        floating[bone as usize].apply(joints::ankle(side)).y - joints::ankle(side).y
    };
    let lower = crate::implicit::smooth_min(
        height(Bone::LeftFoot, 1.0),
        height(Bone::RightFoot, -1.0),
        0.04,
    );
    skeleton.pose(&turns, sway - Vector3::y() * lower)
}

/// The turn of each bone about its joint, in the axes of the resting figure.
fn turns(phase: f64) -> [Matrix3<f64>; BONE_COUNT] {
    let mut turns = [Matrix3::identity(); BONE_COUNT];
    let mut set = |bone: Bone, turn: Matrix3<f64>| turns[bone as usize] = turn;

    let look = sine(phase);
    let stride = sine(STRIDES * phase);
    set(
        Bone::Pelvis,
        about_y(9.0 * look - 4.0 * stride) * about_z(1.5 * stride),
    );
    set(
        Bone::Spine,
        about_y(6.0 * look + 4.0 * stride) * about_x(2.0),
    );
    set(
        Bone::Chest,
        about_y(6.0 * look + 3.0 * stride) * about_z(2.0 * sine(phase + 0.2)),
    );
    set(Bone::Neck, about_y(8.0 * sine(phase - 0.15)));
    set(
        Bone::Head,
        about_y(10.0 * sine(phase - 0.2)) * about_x(4.0 * sine(2.0 * phase)),
    );

    // The left arm hangs and swings against the left leg.
    let swing = sine(STRIDES * phase + 0.5);
    set(
        Bone::LeftUpperArm,
        about_x(-4.0 - 20.0 * swing) * about_z(-34.0),
    );
    let elbow_axis = joints::arm_direction(1.0).cross(&Vector3::z());
    set(Bone::LeftForearm, about(elbow_axis, 24.0 + 12.0 * swing));
    set(
        Bone::LeftHand,
        about(elbow_axis, 6.0 + 6.0 * sine(STRIDES * phase + 0.4)),
    );

    // The right arm is raised sideways, forearm up, and waves.
    let wave = sine(WAVES * phase);
    set(
        Bone::RightUpperArm,
        about_y(18.0) * about_z(-46.0 - 5.0 * sine(phase + 0.3)),
    );
    set(Bone::RightForearm, about_z(-76.0 - 20.0 * wave));
    set(Bone::RightHand, about_z(-14.0 * sine(WAVES * phase - 0.12)));

    let left = [Bone::LeftThigh, Bone::LeftShin, Bone::LeftFoot];
    let right = [Bone::RightThigh, Bone::RightShin, Bone::RightFoot];
    for (leg, offset) in [(left, 0.0), (right, 0.5)] {
        let raised = 0.5 + 0.5 * sine(STRIDES * phase + offset);
        let lift = raised * raised;
        set(leg[0], about_x(-4.0 - 34.0 * lift));
        set(leg[1], about_x(7.0 + 50.0 * lift));
        set(leg[2], about_x(-3.0 - 8.0 * lift));
    }
    turns
}

/// The sine of a fraction of a full turn.
fn sine(fraction: f64) -> f64 {
    libm::sin(TAU * fraction)
}

fn about_x(degrees: f64) -> Matrix3<f64> {
    about(Vector3::x(), degrees)
}

fn about_y(degrees: f64) -> Matrix3<f64> {
    about(Vector3::y(), degrees)
}

fn about_z(degrees: f64) -> Matrix3<f64> {
    about(Vector3::z(), degrees)
}

/// The right-handed rotation about the unit vector `axis` (Rodrigues' formula).
fn about(axis: Vector3<f64>, degrees: f64) -> Matrix3<f64> {
    let (sin, cos) = libm::sincos(degrees.to_radians());
    Matrix3::identity() * cos + axis.cross_matrix() * sin + axis * axis.transpose() * (1.0 - cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bone_moves_rigidly() {
        let skeleton = Skeleton::new();
        for step in 0..40 {
            for bone in pose(&skeleton, f64::from(step) / 40.0) {
                let error = bone.linear * bone.linear.transpose() - Matrix3::identity();
                assert!(error.norm() < 1e-9);
            }
        }
    }

    #[test]
    fn one_foot_always_stands_on_the_ground() {
        let skeleton = Skeleton::new();
        for step in 0..120 {
            let pose = pose(&skeleton, f64::from(step) / 120.0);
            let height = |bone: Bone, side| pose[bone as usize].apply(joints::ankle(side)).y;
            let lower = height(Bone::LeftFoot, 1.0).min(height(Bone::RightFoot, -1.0));
            // The smooth minimum lifts the figure by at most a quarter of its blend, 1 cm.
            assert!((0.089..0.101).contains(&lower), "{lower}");
        }
    }
}
