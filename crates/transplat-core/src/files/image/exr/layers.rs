//! Layers of an OpenEXR file: groups of channels of one name, in one part or several.

use exr::meta::header::Header;

/// Layers that are called like this are the whole image, in this order: the last part of the name, in lower case.
const WHOLE: [&str; 12] = [
    "combined",
    "beauty",
    "rgba",
    "rgb",
    "composite",
    "image",
    "final",
    "ci",
    "c",
    "color",
    "main",
    "default",
];

/// A layer that has colour.
#[derive(Debug, PartialEq)]
pub struct Layer {
    /// The part's name and the layer's in it, empty where neither has one.
    pub name: String,
    /// Part of the file that it is in.
    pub part: usize,
    pub colors: Colors,
    /// The channel of its alpha.
    pub alpha: Option<usize>,
}

/// Channels that are its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Colors {
    Rgb([usize; 3]),
    /// Y, RY and BY.
    LuminanceChroma([usize; 3]),
    Luminance(usize),
}

impl Colors {
    pub fn count(self) -> usize {
        match self {
            Self::Rgb(_) | Self::LuminanceChroma(_) => 3,
            Self::Luminance(_) => 1,
        }
    }
}

impl Layer {
    /// Its colour's channels, and then its alpha's.
    pub fn channels(&self) -> Vec<usize> {
        let mut channels = match self.colors {
            Colors::Rgb(c) | Colors::LuminanceChroma(c) => c.to_vec(),
            Colors::Luminance(y) => vec![y],
        };
        channels.extend(self.alpha);
        channels
    }

    /// Its name for the user.
    pub fn called(&self) -> String {
        match self.name.as_str() {
            "" => "the unnamed one".into(),
            name => format!("{name:?}"),
        }
    }
}

/// All layers with colour, in the file's order; grey ones only where none has three colours.
pub fn layers_of(headers: &[Header]) -> Vec<Layer> {
    let mut layers = Vec::new();
    for (part, header) in headers.iter().enumerate() {
        let names: Vec<String> = header
            .channels
            .list
            .iter()
            .map(|c| c.name.to_string())
            .collect();
        let mut prefixes: Vec<&str> = Vec::new();
        for name in &names {
            let prefix = &name[..name.rfind('.').map_or(0, |dot| dot + 1)];
            if !prefixes.contains(&prefix) {
                prefixes.push(prefix);
            }
        }
        let of_part = header
            .own_attributes
            .layer_name
            .as_ref()
            .map(ToString::to_string);
        let of_part = of_part.filter(|_| headers.len() > 1).unwrap_or_default();
        for prefix in prefixes {
            let find = |letters: &[&str]| {
                let is_it = |name: &String| {
                    let own = name.strip_prefix(prefix).unwrap_or_default();
                    letters.iter().any(|l| own.eq_ignore_ascii_case(l))
                };
                names.iter().position(is_it)
            };
            let all = |of: [&[&str]; 3]| Some([find(of[0])?, find(of[1])?, find(of[2])?]);
            let rgb = || all([&["r", "red"], &["g", "green"], &["b", "blue"]]).map(Colors::Rgb);
            let chroma = || all([&["y"], &["ry"], &["by"]]).map(Colors::LuminanceChroma);
            // Beside X and Z, Y is a coordinate.
            let is_vector = find(&["x"]).is_some() && find(&["z"]).is_some();
            let grey = || find(&["y", "l", "luminance"]).filter(|_| !is_vector);
            let grey = || grey().map(Colors::Luminance);
            let Some(colors) = rgb().or_else(chroma).or_else(grey) else {
                continue;
            };
            let own = prefix.trim_end_matches('.');
            let is_told_twice = own.eq_ignore_ascii_case(&of_part) || own.is_empty();
            let name = match (of_part.as_str(), own) {
                (part, _) if is_told_twice => part.to_owned(),
                ("", own) => own.to_owned(),
                (part, own) => format!("{part}.{own}"),
            };
            layers.push(Layer {
                name,
                part,
                colors,
                alpha: find(&["a", "alpha"]),
            });
        }
    }
    if layers.iter().any(|l| l.colors.count() == 3) {
        layers.retain(|l| l.colors.count() == 3);
    }
    layers
}

/// The layer that is the image, and whether its name says so: the unnamed one, or the one that is called as the whole image usually is, or
/// else the first.
pub fn default_layer(layers: &[Layer]) -> Option<(usize, bool)> {
    if layers.len() == 1 {
        return Some((0, true));
    }
    if let Some(unnamed) = layers.iter().position(|l| l.name.is_empty()) {
        return Some((unnamed, true));
    }
    let last = |l: &Layer| {
        l.name
            .rsplit('.')
            .next()
            .unwrap_or_default()
            .to_ascii_lowercase()
    };
    let mut known = WHOLE.iter();
    let found = known.find_map(|whole| layers.iter().position(|l| last(l) == *whole));
    // Identifiers that are stored as colours.
    let is_image = |l: &Layer| !l.name.to_ascii_lowercase().contains("crypto");
    let first = || layers.iter().position(is_image);
    match found {
        Some(found) => Some((found, true)),
        None => Some((first().unwrap_or(0), false)).filter(|_| !layers.is_empty()),
    }
}

/// The layer of that name, or the only one that ends with it.
pub fn named_layer(layers: &[Layer], name: &str) -> Result<usize, String> {
    let is_it = |l: &Layer| l.name.eq_ignore_ascii_case(name);
    if let Some(found) = layers.iter().position(is_it) {
        return Ok(found);
    }
    let end = format!(".{}", name.to_ascii_lowercase());
    let ends = |l: &Layer| l.name.to_ascii_lowercase().ends_with(&end);
    let mut among = (0..layers.len()).filter(|i| ends(&layers[*i]));
    match (among.next(), among.next()) {
        (Some(found), None) => Ok(found),
        _ => {
            let names: Vec<String> = layers.iter().map(Layer::called).collect();
            Err(format!(
                "has no layer {name:?}; it has {}",
                names.join(", ")
            ))
        }
    }
}
