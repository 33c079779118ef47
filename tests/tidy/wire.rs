//! The wire contract's document and code change together.

use crate::root;

#[test]
fn the_document_states_the_hash_of_the_schema() {
    let text = std::fs::read_to_string(root().join("docs/wire-format.md")).expect("the document");
    let hash = format!("{:016x}", cosplat_ipc::schema::schema_hash());
    assert!(
        text.contains(&hash),
        "docs/wire-format.md does not state {hash}: describe the change and state the new hash"
    );
}
