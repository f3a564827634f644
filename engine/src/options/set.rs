//! `--set key=value`.

/// Read `key=value` as it stands after `--set`: the value is TOML, a bare word is a string.
///
/// # Errors
/// A sentence for the user when there is no `=` or no key.
pub fn parse_set(text: &str) -> Result<(String, toml::Value), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("`{text}` has no `=`: write key=value"))?;
    let (key, value) = (key.trim(), value.trim());
    if key.is_empty() {
        return Err(format!("`{text}` has no key before the `=`"));
    }
    let parsed = toml::from_str::<toml::Table>(&format!("value = {value}")).ok().and_then(|mut t| t.remove("value"));
    Ok((key.to_string(), parsed.unwrap_or_else(|| toml::Value::String(value.to_string()))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_values_are_toml_and_bare_words_are_strings() {
        assert_eq!(parse_set("lr=1e-2").unwrap(), ("lr".into(), toml::Value::Float(0.01)));
        assert_eq!(parse_set("levels = 8").unwrap(), ("levels".into(), toml::Value::Integer(8)));
        assert_eq!(parse_set("space=ndc").unwrap(), ("space".into(), toml::Value::String("ndc".into())));
        assert!(parse_set("lr").is_err() && parse_set("=3").is_err());
    }
}
