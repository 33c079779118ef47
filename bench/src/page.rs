//! Parts of Markdown pages that are measured: what stands between `<!-- begin: NAME -->` and `<!-- end: NAME -->`.

use std::{fs, path::Path};

use anyhow::Context;

/// Whether a page has these parts. To be asked before anything is measured.
///
/// # Errors
/// When it cannot be read or lacks a marker.
pub fn check(path: &Path, parts: &[&str]) -> anyhow::Result<()> {
    let parts: Vec<_> = parts.iter().map(|&name| (name, String::new())).collect();
    replaced(path, &parts).map(|_| ())
}

/// Replaces parts of a page.
///
/// # Errors
/// When it cannot be read or written or lacks a marker.
pub fn put(path: &Path, parts: &[(&str, String)]) -> anyhow::Result<()> {
    fs::write(path, replaced(path, parts)?)
        .with_context(|| format!("cannot write {}", path.display()))
}

fn replaced(path: &Path, parts: &[(&str, String)]) -> anyhow::Result<String> {
    let mut page =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    for (name, text) in parts {
        let [begin, end] = ["begin", "end"].map(|edge| format!("<!-- {edge}: {name} -->"));
        let missing = || format!("{} lacks the lines {begin} and {end}", path.display());
        let (head, rest) = page.split_once(&begin).with_context(missing)?;
        let (_, tail) = rest.split_once(&end).with_context(missing)?;
        page = format!("{head}{begin}\n\n{}\n\n{end}{tail}", text.trim_end());
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_replaced_and_a_missing_one_is_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("page.md");
        let page = "head\n<!-- begin: one -->\nold\n<!-- end: one -->\ntail\n";
        fs::write(&path, page).expect("writable");
        put(&path, &[("one", "new\n".into())]).expect("the part is there");
        let found = fs::read_to_string(&path).expect("readable");
        assert_eq!(
            found,
            "head\n<!-- begin: one -->\n\nnew\n\n<!-- end: one -->\ntail\n"
        );
        let error = check(&path, &["one", "two"]).expect_err("there is no second part");
        assert!(error.to_string().contains("<!-- begin: two -->"), "{error}");
    }
}
