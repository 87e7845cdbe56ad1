//! Whether vehicles of a scenario may have devices.

use crate::network::tree::Element;

/// Returns whether an option, or a parameter or attribute in a file, asks for a device, whatever it is.
pub(super) fn are_asked_for<'a>(options: &[(String, String)], roots: impl IntoIterator<Item = &'a Element>) -> bool {
    let in_options = options.iter().any(|(name, _)| asks(name));
    in_options || roots.into_iter().any(is_in)
}

fn is_in(element: &Element) -> bool {
    let mut attributes = element.attributes.iter();
    attributes.any(|(key, value)| asks(key) || key == "key" && asks(value)) || element.children.iter().any(is_in)
}

/// Returns whether it is a name such as `device.rerouting.probability` or `has.battery.device`.
fn asks(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.contains("device.") || name.starts_with("has.")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree;

    #[test]
    fn options_parameters_and_attributes_ask_for_devices() {
        let asks = |options: &[&str], text: &str| {
            let options: Vec<_> = options.iter().map(|name| ((*name).to_owned(), "1".to_owned())).collect();
            are_asked_for(&options, [&tree::parse(text).unwrap()])
        };
        let none =
            r#"<routes><vType id="a"><param key="color" value="1"/></vType><vehicle id="has.b" depart="1"/></routes>"#;
        assert!(!asks(&["time-to-teleport"], none));
        assert!(asks(&["device.rerouting.probability"], none));
        assert!(asks(&[], r#"<routes><vType id="a"><param key="has.battery.device" value="true"/></vType></routes>"#));
        assert!(asks(&[], r#"<routes><vehicle id="a"><param key="device.toc.x" value="1"/></vehicle></routes>"#));
        assert!(asks(&[], r#"<routes><vType id="a" has.fcd.device="true"/></routes>"#));
    }
}
