//! The formats and their names.

/// A mesh file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Polygon File Format (Stanford), ASCII or binary.
    Ply,
    /// glTF 2.0: the binary container; JSON text is read as well.
    Glb,
    /// Draco.
    Drc,
    /// Steadymesh's own: a bincode envelope and raw arrays.
    Native,
    /// One of the others with an image: Steadymesh's own.
    Bundle,
}

/// A format, its file extensions and its content types; the first of each is preferred.
type Names = (Format, &'static [&'static str], &'static [&'static str]);

const NAMES: [Names; 6] = [
    (Format::Obj, &["obj"], &["model/obj"]),
    (Format::Ply, &["ply"], &["model/ply", "application/x-ply"]),
    (
        Format::Glb,
        &["glb", "gltf"],
        &["model/gltf-binary", "model/gltf+json"],
    ),
    (Format::Drc, &["drc"], &["application/vnd.draco"]),
    (
        Format::Native,
        &["smf"],
        &[steadymesh_proto::NATIVE_CONTENT_TYPE],
    ),
    (
        Format::Bundle,
        &["smb"],
        &[steadymesh_proto::BUNDLE_CONTENT_TYPE],
    ),
];

impl Format {
    /// The format of files with this extension, without the dot, in any case.
    #[must_use]
    pub fn from_extension(extension: &str) -> Option<Self> {
        NAMES
            .iter()
            .find(|row| {
                row.1
                    .iter()
                    .any(|name| extension.eq_ignore_ascii_case(name))
            })
            .map(|row| row.0)
    }

    /// The file extension, without the dot.
    #[must_use]
    pub fn extension(self) -> &'static str {
        self.names().1[0]
    }

    /// The format of a media type; parameters such as `; charset=utf-8` are ignored.
    #[must_use]
    pub fn from_content_type(content_type: &str) -> Option<Self> {
        let essence = content_type.split(';').next().unwrap_or_default().trim();
        NAMES
            .iter()
            .find(|row| row.2.iter().any(|name| essence.eq_ignore_ascii_case(name)))
            .map(|row| row.0)
    }

    /// The media type.
    #[must_use]
    pub fn content_type(self) -> &'static str {
        self.names().2[0]
    }

    fn names(self) -> &'static Names {
        match self {
            Self::Obj => &NAMES[0],
            Self::Ply => &NAMES[1],
            Self::Glb => &NAMES[2],
            Self::Drc => &NAMES[3],
            Self::Native => &NAMES[4],
            Self::Bundle => &NAMES[5],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_found_again_by_each_of_its_names() {
        for (format, extensions, content_types) in NAMES {
            assert_eq!(format.extension(), extensions[0]);
            for name in extensions {
                assert_eq!(Format::from_extension(&name.to_uppercase()), Some(format));
            }
            assert_eq!(format.content_type(), content_types[0]);
            for name in content_types {
                let with_parameter = format!(" {name} ; charset=utf-8");
                assert_eq!(Format::from_content_type(&with_parameter), Some(format));
            }
        }
        assert_eq!(Format::from_extension("stl"), None);
        assert_eq!(Format::from_content_type("application/octet-stream"), None);
    }
}
