//! From a stream's configuration, as users write it, to the pipeline's settings.

use serde::{Deserialize, Serialize};
use steadymesh_draco::EncodeOptions;
use steadymesh_mesh_io::MAX_IMAGE_SIZE;
use steadymesh_proto::recording::Record;
use steadymesh_proto::stream::{DracoConfig, Overload, StreamConfig, TextureConfig};

use crate::pipeline::{AttributeWeight, InvalidSettings, Settings, TargetSize, TrackingStrength};
use crate::textures::TextureSettings;

use super::StreamPattern;

/// Quantization that makes sense: below, a figure looks like building blocks; above, a
/// 32-bit float has no more to give.
pub const POSITION_BITS: std::ops::RangeInclusive<u8> = 6..=20;
const TEXTURE_COORDINATE_BITS: std::ops::RangeInclusive<u8> = 6..=20;
const NORMAL_BITS: std::ops::RangeInclusive<u8> = 6..=16;
const SPEED: std::ops::RangeInclusive<u8> = 0..=10;
const QUALITY: std::ops::RangeInclusive<u8> = 1..=100;
/// The same limit as that of images that come in.
const MAX_SIZE: std::ops::RangeInclusive<u32> = 16..=MAX_IMAGE_SIZE;

/// A configuration that has been checked, with what it means.
#[derive(Debug, Clone, PartialEq)]
pub struct Configured {
    /// The configuration, defaults filled in.
    pub config: StreamConfig,
    /// The same for the pipeline.
    pub settings: Settings,
    /// What becomes of the images that come with its frames.
    pub texture: TextureSettings,
    /// What happens when frames come too fast.
    pub overload: Overload,
    /// What is recorded.
    pub record: Record,
}

/// Defaults for the streams whose names match.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StreamRule {
    /// Which streams.
    #[serde(rename = "match")]
    pub pattern: StreamPattern,
    /// What their configuration leaves out.
    pub defaults: StreamConfig,
}

/// Why a configuration cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidConfig {
    /// The two ways of giving a target exclude each other.
    #[error("target_faces and target_ratio are both given: leave one of them out")]
    TwoTargets,
    /// The target or the tracking's strength is out of range.
    #[error(transparent)]
    Settings(#[from] InvalidSettings),
    /// A number out of its range.
    #[error("{name} is {found}: it must be from {min} to {max}")]
    OutOfRange {
        /// The field.
        name: &'static str,
        /// What was asked for.
        found: u32,
        /// The smallest.
        min: u32,
        /// The largest.
        max: u32,
    },
    /// Something is to be recorded, and the server has no place for it.
    #[error(
        "record is {}: the server keeps no recordings, which takes recordings.url in its \
         configuration",
        found.name()
    )]
    NoRecordings {
        /// What was asked for.
        found: Record,
    },
}

impl Configured {
    /// Checks configurations of which each fills in what those before it leave out, and the
    /// pipeline's own defaults what all of them leave out.
    ///
    /// # Errors
    ///
    /// [`InvalidConfig`] names the value and its range.
    pub fn new(layers: &[&StreamConfig], max_faces: usize) -> Result<Self, InvalidConfig> {
        let own = Settings::default();
        let mut target = None;
        for layer in layers.iter().rev() {
            target = target_of(layer)?.or(target);
        }
        let target = target.unwrap_or(own.target).check(max_faces)?;
        let tracking = first(layers, |layer| layer.tracking).unwrap_or(own.tracking);
        let tracking_strength = match first(layers, |layer| layer.tracking_strength) {
            Some(strength) => TrackingStrength::new(strength)?,
            None => own.tracking_strength,
        };
        let attribute_weight = match first(layers, |layer| layer.attribute_weight) {
            Some(weight) => AttributeWeight::new(weight)?,
            None => own.attribute_weight,
        };
        let metrics = first(layers, |layer| layer.metrics).unwrap_or_default();
        let overload = first(layers, |layer| layer.overload).unwrap_or_default();
        let record = first(layers, |layer| layer.record).unwrap_or_default();
        let (draco, texture) = (draco(layers, own.draco)?, texture(layers)?);
        let (target_faces, target_ratio) = match target {
            TargetSize::Faces(faces) => (Some(faces), None),
            TargetSize::Ratio(ratio) => (None, Some(ratio)),
        };
        Ok(Self {
            config: StreamConfig {
                target_faces,
                target_ratio,
                tracking: Some(tracking),
                tracking_strength: Some(tracking_strength.get()),
                attribute_weight: Some(attribute_weight.get()),
                draco: DracoConfig {
                    position_bits: Some(draco.position_bits),
                    speed: Some(draco.speed),
                    texture_coordinate_bits: Some(draco.texture_coordinate_bits),
                    normal_bits: Some(draco.normal_bits),
                },
                texture: TextureConfig {
                    format: Some(texture.format),
                    quality: Some(texture.quality),
                    max_size: texture.max_size,
                },
                metrics: Some(metrics),
                overload: Some(overload),
                record: Some(record),
            },
            settings: Settings {
                target,
                tracking,
                tracking_strength,
                attribute_weight,
                draco,
                metrics,
                ..own
            },
            texture,
            overload,
            record,
        })
    }
}

fn draco(layers: &[&StreamConfig], own: EncodeOptions) -> Result<EncodeOptions, InvalidConfig> {
    let asked = |value: fn(&DracoConfig) -> Option<u8>| first(layers, |layer| value(&layer.draco));
    let mut draco = own;
    for (name, found, range, field) in [
        (
            "draco.position_bits",
            asked(|draco| draco.position_bits),
            POSITION_BITS,
            &mut draco.position_bits,
        ),
        (
            "draco.texture_coordinate_bits",
            asked(|draco| draco.texture_coordinate_bits),
            TEXTURE_COORDINATE_BITS,
            &mut draco.texture_coordinate_bits,
        ),
        (
            "draco.normal_bits",
            asked(|draco| draco.normal_bits),
            NORMAL_BITS,
            &mut draco.normal_bits,
        ),
        (
            "draco.speed",
            asked(|draco| draco.speed),
            SPEED,
            &mut draco.speed,
        ),
    ] {
        if let Some(found) = found {
            *field = within(name, found, &range)?;
        }
    }
    Ok(draco)
}

fn texture(layers: &[&StreamConfig]) -> Result<TextureSettings, InvalidConfig> {
    let own = TextureSettings::default();
    let quality = first(layers, |layer| layer.texture.quality);
    let max_size = first(layers, |layer| layer.texture.max_size);
    let max_size = max_size.map(|size| within("texture.max_size", size, &MAX_SIZE));
    Ok(TextureSettings {
        format: first(layers, |layer| layer.texture.format).unwrap_or(own.format),
        quality: within("texture.quality", quality.unwrap_or(own.quality), &QUALITY)?,
        max_size: max_size.transpose()?,
    })
}

fn within<T: Copy + PartialOrd + Into<u32>>(
    name: &'static str,
    found: T,
    range: &std::ops::RangeInclusive<T>,
) -> Result<T, InvalidConfig> {
    if range.contains(&found) {
        return Ok(found);
    }
    Err(InvalidConfig::OutOfRange {
        name,
        found: found.into(),
        min: (*range.start()).into(),
        max: (*range.end()).into(),
    })
}

/// The value of the first layer that has one.
fn first<T>(layers: &[&StreamConfig], value: impl Fn(&StreamConfig) -> Option<T>) -> Option<T> {
    layers.iter().find_map(|layer| value(layer))
}

fn target_of(config: &StreamConfig) -> Result<Option<TargetSize>, InvalidConfig> {
    match (config.target_faces, config.target_ratio) {
        (Some(_), Some(_)) => Err(InvalidConfig::TwoTargets),
        (Some(faces), None) => Ok(Some(TargetSize::Faces(faces))),
        (None, Some(ratio)) => Ok(Some(TargetSize::Ratio(ratio))),
        (None, None) => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use steadymesh_proto::metrics::Tracking;
    use steadymesh_proto::stream::MetricsMode;

    fn parse(asked: &str, defaults: &str) -> Result<Configured, InvalidConfig> {
        let config = |text| serde_json::from_str::<StreamConfig>(text).unwrap();
        Configured::new(&[&config(asked), &config(defaults)], 2_000_000)
    }

    #[test]
    fn what_is_left_out_comes_from_the_defaults() {
        let defaults = r#"{"target_ratio": 0.25, "tracking": "off", "draco": {"speed": 7}}"#;
        let out = parse(r#"{"draco": {"position_bits": 14}}"#, defaults).unwrap();
        assert_eq!(out.settings.target, TargetSize::Ratio(0.25));
        assert_eq!(out.settings.tracking, Tracking::Off);
        assert_eq!(
            (out.settings.draco.position_bits, out.settings.draco.speed),
            (14, 7)
        );
        assert_eq!(out.config.target_faces, None);
        assert_eq!(out.settings.metrics, MetricsMode::Full);
    }

    #[test]
    fn a_target_that_is_asked_for_replaces_a_default_of_the_other_kind() {
        let out = parse(r#"{"target_faces": 500}"#, r#"{"target_ratio": 0.5}"#).unwrap();
        assert_eq!(out.settings.target, TargetSize::Faces(500));
    }

    #[test]
    fn values_out_of_range_are_refused_by_name() {
        for (asked, name) in [
            (r#"{"target_faces": 3}"#, "target_faces is 3"),
            (
                r#"{"target_faces": 9000000000}"#,
                "target_faces is 9000000000",
            ),
            (r#"{"target_ratio": 0}"#, "target_ratio is 0"),
            (r#"{"target_ratio": 0.5, "target_faces": 40}"#, "both given"),
            (
                r#"{"tracking_strength": 1.5}"#,
                "tracking_strength is 1.5: it must be from 0 to 1",
            ),
            (
                r#"{"attribute_weight": 2}"#,
                "attribute_weight is 2: it must be from 0 to 1",
            ),
            (
                r#"{"tracking_strength": -0.1}"#,
                "tracking_strength is -0.1",
            ),
            (
                r#"{"draco": {"position_bits": 40}}"#,
                "draco.position_bits is 40",
            ),
            (r#"{"draco": {"speed": 11}}"#, "draco.speed is 11"),
            (
                r#"{"draco": {"texture_coordinate_bits": 5}}"#,
                "draco.texture_coordinate_bits is 5: it must be from 6 to 20",
            ),
            (
                r#"{"draco": {"normal_bits": 17}}"#,
                "draco.normal_bits is 17",
            ),
            (
                r#"{"texture": {"quality": 0}}"#,
                "texture.quality is 0: it must be from 1 to 100",
            ),
            (r#"{"texture": {"max_size": 15}}"#, "texture.max_size is 15"),
        ] {
            let message = parse(asked, "{}").unwrap_err().to_string();
            assert!(message.contains(name), "{asked}: {message}");
        }
    }
}
