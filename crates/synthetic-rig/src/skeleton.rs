//! Bones, how the skin hangs on them, and poses.
//!
//! Skin follows the bones by linear blend skinning with weights that are smooth
//! functions of the material (rest) point, so every material point moves on an
//! exactly known path.

use nalgebra::{Matrix3, Vector3};

use crate::body::joints;

/// How many bones there are.
pub(crate) const BONE_COUNT: usize = 17;

/// The bones; a parent comes before its children.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bone {
    Pelvis,
    Spine,
    Chest,
    Neck,
    Head,
    LeftUpperArm,
    LeftForearm,
    LeftHand,
    RightUpperArm,
    RightForearm,
    RightHand,
    LeftThigh,
    LeftShin,
    LeftFoot,
    RightThigh,
    RightShin,
    RightFoot,
}

/// A rotation followed by a translation, or a weighted sum of such maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Affine {
    pub(crate) linear: Matrix3<f64>,
    pub(crate) translation: Vector3<f64>,
}

impl Affine {
    pub(crate) fn apply(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.linear * point + self.translation
    }
}

/// Where every bone is: `posed_from_rest`, in the order of [`Bone`].
pub(crate) type Pose = [Affine; BONE_COUNT];

/// A bone's place at rest and the capsule of skin that clings to it.
#[derive(Debug, Clone)]
struct BoneShape {
    parent: Option<Bone>,
    joint: Vector3<f64>,
    start: Vector3<f64>,
    segment: Vector3<f64>,
    radii: [f64; 2],
}

/// The figure's skeleton at rest.
#[derive(Debug, Clone)]
pub(crate) struct Skeleton {
    bones: Vec<BoneShape>,
}

impl Skeleton {
    pub(crate) fn new() -> Self {
        let mut bones = trunk();
        bones.extend([1.0, -1.0].into_iter().flat_map(arm));
        bones.extend([1.0, -1.0].into_iter().flat_map(leg));
        Self { bones }
    }

    /// The pose in which every bone is turned by `turns` about its joint, relative to its parent.
    ///
    /// The axes of the turns are those of the resting figure; `shift` moves the whole figure.
    pub(crate) fn pose(&self, turns: &[Matrix3<f64>; BONE_COUNT], shift: Vector3<f64>) -> Pose {
        let mut pose = [Affine {
            linear: Matrix3::identity(),
            translation: shift,
        }; BONE_COUNT];
        for (index, bone) in self.bones.iter().enumerate() {
            let parent = match bone.parent {
                Some(parent) => pose[parent as usize],
                None => Affine {
                    linear: Matrix3::identity(),
                    translation: shift,
                },
            };
            let linear = parent.linear * turns[index];
            let translation = parent.apply(bone.joint) - linear * bone.joint;
            pose[index] = Affine {
                linear,
                translation,
            };
        }
        pose
    }

    /// The share of each bone in the motion of the material point `rest`; they sum to 1.
    pub(crate) fn weights(&self, rest: Vector3<f64>) -> [f64; BONE_COUNT] {
        // How much closer (in metres) a bone must be to outweigh another by a factor e:
        // tuned so that elbows and knees bend over about a radius of the limb.
        const SOFTNESS: f64 = 0.011;
        // e^−20 is 2e-9: leaving such bones out moves nothing by more than a few nanometres.
        const NEGLIGIBLE: f64 = 20.0 * SOFTNESS;
        let mut weights = [0.0; BONE_COUNT];
        for (weight, bone) in weights.iter_mut().zip(&self.bones) {
            *weight = bone.distance(rest);
        }
        let nearest = weights.iter().copied().fold(f64::INFINITY, f64::min);
        let mut sum = 0.0;
        for weight in &mut weights {
            let excess = *weight - nearest;
            *weight = if excess < NEGLIGIBLE {
                libm::exp(-excess / SOFTNESS)
            } else {
                0.0
            };
            sum += *weight;
        }
        weights.map(|weight| weight / sum)
    }
}

/// The blend of the bones' maps by `weights`.
pub(crate) fn blend(pose: &Pose, weights: &[f64; BONE_COUNT]) -> Affine {
    let mut sum = Affine {
        linear: Matrix3::zeros(),
        translation: Vector3::zeros(),
    };
    for (bone, &weight) in pose.iter().zip(weights) {
        if weight > 0.0 {
            sum.linear += bone.linear * weight;
            sum.translation += bone.translation * weight;
        }
    }
    sum
}

impl BoneShape {
    fn new(parent: Option<Bone>, start: Vector3<f64>, end: Vector3<f64>, radii: [f64; 2]) -> Self {
        Self {
            parent,
            joint: start,
            start,
            segment: end - start,
            radii,
        }
    }

    fn turning_about(mut self, joint: Vector3<f64>) -> Self {
        self.joint = joint;
        self
    }

    fn distance(&self, point: Vector3<f64>) -> f64 {
        let from_start = point - self.start;
        let along = (from_start.dot(&self.segment) / self.segment.norm_squared()).clamp(0.0, 1.0);
        let radius = self.radii[0] + (self.radii[1] - self.radii[0]) * along;
        (from_start - self.segment * along).norm() - radius
    }
}

fn trunk() -> Vec<BoneShape> {
    let at = Vector3::new;
    vec![
        BoneShape::new(
            None,
            at(-0.07, 0.94, 0.0),
            at(0.07, 0.94, 0.0),
            [0.115, 0.115],
        )
        .turning_about(at(0.0, 0.95, 0.0)),
        BoneShape::new(
            Some(Bone::Pelvis),
            at(-0.04, 1.11, 0.0),
            at(0.04, 1.11, 0.0),
            [0.115, 0.115],
        )
        .turning_about(at(0.0, 1.04, -0.01)),
        BoneShape::new(
            Some(Bone::Spine),
            at(-0.07, 1.34, -0.01),
            at(0.07, 1.34, -0.01),
            [0.135, 0.135],
        )
        .turning_about(at(0.0, 1.20, -0.01)),
        BoneShape::new(
            Some(Bone::Chest),
            at(0.0, 1.51, -0.01),
            at(0.0, 1.57, 0.0),
            [0.06, 0.055],
        ),
        BoneShape::new(
            Some(Bone::Neck),
            at(0.0, 1.65, 0.0),
            at(0.0, 1.72, 0.0),
            [0.085, 0.085],
        )
        .turning_about(at(0.0, 1.585, -0.005)),
    ]
}

fn arm(side: f64) -> [BoneShape; 3] {
    let (upper, fore) = if side > 0.0 {
        (Bone::LeftUpperArm, Bone::LeftForearm)
    } else {
        (Bone::RightUpperArm, Bone::RightForearm)
    };
    let on_arm = |length: f64| joints::along_arm(side, length);
    let (elbow, wrist) = (on_arm(joints::ELBOW), on_arm(joints::WRIST));
    [
        BoneShape::new(Some(Bone::Chest), on_arm(0.03), elbow, [0.058, 0.046])
            .turning_about(joints::shoulder(side)),
        BoneShape::new(Some(upper), elbow, wrist, [0.046, 0.033]),
        BoneShape::new(
            Some(fore),
            on_arm(joints::WRIST + 0.03),
            on_arm(0.70),
            [0.033, 0.02],
        )
        .turning_about(wrist),
    ]
}

fn leg(side: f64) -> [BoneShape; 3] {
    let (thigh, shin) = if side > 0.0 {
        (Bone::LeftThigh, Bone::LeftShin)
    } else {
        (Bone::RightThigh, Bone::RightShin)
    };
    let (hip, knee, ankle) = (joints::hip(side), joints::knee(side), joints::ankle(side));
    let below_hip = hip + (knee - hip) * 0.2;
    let toes = Vector3::new(side * 0.148, 0.04, 0.13);
    [
        BoneShape::new(Some(Bone::Pelvis), below_hip, knee, [0.085, 0.062]).turning_about(hip),
        BoneShape::new(Some(thigh), knee, ankle, [0.062, 0.05]),
        BoneShape::new(Some(shin), ankle - Vector3::y() * 0.04, toes, [0.05, 0.045])
            .turning_about(ankle),
    ]
}
