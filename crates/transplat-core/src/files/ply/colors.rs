//! Colour properties of a PLY.

/// The colour that a property is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ColorOf {
    /// SH coefficient of a channel.
    Sh(usize, usize),
    /// A channel as it is shown, and nothing else: where there is no SH.
    Shown(usize),
}

impl ColorOf {
    /// Colour that a property of that name is in a file of so many coefficients; in the file, all of red's higher ones come first, then green's, then
    /// blue's.
    pub(super) fn of_name(name: &str, coefficients: usize, has_sh: bool) -> Option<Self> {
        let number = |prefix: &str| name.strip_prefix(prefix)?.parse::<usize>().ok();
        if let Some(channel) = number("f_dc_") {
            return (channel < 3).then_some(Self::Sh(0, channel));
        }
        if let (Some(i), 2..) = (number("f_rest_"), coefficients) {
            let rest = coefficients - 1;
            return Some(Self::Sh(i % rest + 1, i / rest));
        }
        let shown = SHOWN
            .iter()
            .find_map(|names| names.iter().position(|n| *n == name));
        shown.filter(|_| !has_sh).map(Self::Shown)
    }
}

/// Names of the channels of a colour that is no SH.
pub(super) const SHOWN: [[&str; 3]; 3] = [
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["r", "g", "b"],
];
