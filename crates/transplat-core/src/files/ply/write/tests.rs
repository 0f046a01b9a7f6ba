use crate::files::*;

const HEADER: &str = "comment kept\nelement camera 1\nproperty int id\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty uchar tag\nproperty double opacity\nproperty float f_dc_2\nproperty float f_dc_1\nproperty float f_dc_0\nproperty float scale_0\nproperty float scale_1\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\nelement tail 2\nproperty uchar t\nend_header\n";

fn ascii() -> Vec<u8> {
    let rows = "7\n0 0 0 9 1.5 0.1 0.2 0.3 -1 -2 1 0 0 0\n1 nan 1 8 2.5 0.4 0.5 0.6 -1 -2 1 0 0 0\n1 0 2 8 2.5 0.4 0.5 0.6 -1 -2 1 0 0 0\n";
    let mut text =
        format!("ply\nformat ascii 1.0\n{HEADER}{rows}").replace("vertex 2", "vertex 13");
    for i in 0..10 {
        text += &format!("{i} 2 2 8 2.5 0.4 0.5 0.6 -1 -2 1 0 0 0\n");
    }
    (text + "3\n4\n").into_bytes()
}

fn binary(big_endian: bool) -> Vec<u8> {
    let name = if big_endian { "big" } else { "little" };
    let mut out = format!("ply\nformat binary_{name}_endian 1.0\n{HEADER}").into_bytes();
    let mut put = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        if big_endian {
            bytes.reverse();
        }
        out.extend(bytes);
    };
    put(&7i32.to_le_bytes());
    for row in 0..2u8 {
        for v in [0f32, 1.0, f32::from(row)] {
            put(&v.to_le_bytes());
        }
        put(&[9 - row]);
        put(&1.5f64.to_le_bytes());
        for v in [0.1f32, 0.2, 0.3, -1.0, -2.0, 1.0, 0.0, 0.0, 0.0] {
            put(&v.to_le_bytes());
        }
    }
    put(&[3]);
    put(&[4]);
    out
}

#[test]
fn only_the_colour_of_a_binary_file_changes() {
    for big_endian in [false, true] {
        let folder = tempfile::tempdir().expect("a folder");
        let (from, to) = (folder.path().join("a.ply"), folder.path().join("b.ply"));
        let original = binary(big_endian);
        std::fs::write(&from, &original).expect("room for it");
        let (cloud, asset) = load_splat(&from).expect("a good file");
        assert_eq!(*cloud.sh, [[0.3, 0.2, 0.1]; 2]);
        write_relit(&asset, &cloud, &cloud.sh, &to).expect("room for it");
        assert_eq!(std::fs::read(&to).expect("it is there"), original);
        write_relit(&asset, &cloud, &[[5.0, 6.0, 7.0], [8.0, 9.0, 10.0]], &to)
            .expect("room for it");
        let (other, _) = load_splat(&to).expect("a good file");
        assert_eq!(*other.sh, [[5.0, 6.0, 7.0], [8.0, 9.0, 10.0]]);
        assert_eq!(other.positions, cloud.positions);
        let changed = std::fs::read(&to).expect("it is there");
        assert_eq!(changed.len(), original.len());
        // Tail elements are still there.
        assert_eq!(changed[changed.len() - 2..], [3, 4]);
    }
}

#[test]
fn ascii_keeps_its_words_and_makes_broken_rows_harmless() {
    let folder = tempfile::tempdir().expect("a folder");
    let (from, to) = (folder.path().join("a.ply"), folder.path().join("b.ply"));
    std::fs::write(&from, ascii()).expect("room for it");
    let (cloud, asset) = load_splat(&from).expect("mostly good");
    assert_eq!(asset.report.skipped_work, [1]);
    write_relit(&asset, &cloud, &vec![[1.0, 2.0, 3.0]; cloud.len()], &to).expect("room for it");
    let text = std::fs::read_to_string(&to).expect("it is there");
    let mut lines = text.lines().skip_while(|l| *l != "end_header").skip(1);
    assert_eq!(lines.next(), Some("7"));
    assert_eq!(lines.next(), Some("0 0 0 9 1.5 3 2 1 -1 -2 1 0 0 0"));
    assert_eq!(lines.next(), Some("1 0 1 8 -30 3 2 1 -1 -2 1 0 0 0"));
    assert_eq!(text.lines().last(), Some("4"));
}

#[test]
fn a_changed_source_is_noticed() {
    let folder = tempfile::tempdir().expect("a folder");
    let from = folder.path().join("a.ply");
    std::fs::write(&from, binary(false)).expect("room for it");
    let (cloud, asset) = load_splat(&from).expect("a good file");
    std::fs::write(&from, &binary(false)[..300]).expect("room for it");
    let to = folder.path().join("b.ply");
    assert!(write_relit(&asset, &cloud, &cloud.sh, &to).is_err());
    assert!(!to.exists());
}

/// The surfels that some rows are.
fn surfels<const N: usize>(asset: &SplatFile, rows: [usize; N]) -> [usize; N] {
    rows.map(|row| asset.surfel_of(row).expect("a row"))
}

#[test]
fn a_part_has_its_own_rows_and_what_the_file_has_beside_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let (from, to) = (folder.path().join("a.ply"), folder.path().join("b.ply"));
    std::fs::write(&from, ascii()).expect("room for it");
    let (cloud, asset) = load_splat(&from).expect("mostly good");
    let part = asset.part(&surfels(&asset, [1, 3]));
    write_relit(&part, &cloud, &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], &to).expect("room for it");
    let text = std::fs::read_to_string(&to).expect("it is there");
    assert!(text.contains("\nelement vertex 2\n") && text.contains("\nelement camera 1\n"));
    let lines: Vec<&str> = text.lines().skip_while(|l| *l != "end_header").collect();
    assert_eq!(
        lines[1..],
        [
            "7",
            "1 0 1 8 -30 3 2 1 -1 -2 1 0 0 0",
            "0 2 2 8 2.5 6 5 4 -1 -2 1 0 0 0",
            "3",
            "4"
        ]
    );
    for big_endian in [false, true] {
        std::fs::write(&from, binary(big_endian)).expect("room for it");
        let (cloud, asset) = load_splat(&from).expect("a good file");
        let part = asset.part(&surfels(&asset, [1]));
        write_relit(&part, &cloud, &[[4.0, 5.0, 6.0]], &to).expect("room for it");
        let (back, _) = load_splat(&to).expect("a good file");
        assert_eq!(back.positions, cloud.positions[1..]);
        assert_eq!(*back.sh, [[4.0, 5.0, 6.0]]);
        let written = std::fs::read(&to).expect("it is there");
        assert_eq!(written[written.len() - 2..], [3, 4]);
        assert!(write_relit(&part, &cloud, &cloud.sh, &to).is_err());
    }
}
