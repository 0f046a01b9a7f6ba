//! Structs that cross to the GPU: declared once, and each held by a test of its name against the WGSL by name, offset and size.

/// A field of a struct: name, offset and size in bytes.
#[cfg(test)]
pub struct Field {
    pub name: &'static str,
    pub offset: usize,
    pub size: usize,
}

/// Declares plain structs of a shader.
macro_rules! gpu_struct {
    (in $shader:literal; $($(#[$meta:meta])* struct $name:ident { $($field:ident: $type:ty),* $(,)? })*) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        struct $name {
            $($field: $type),*
        }

        #[cfg(test)]
        #[test]
        #[allow(non_snake_case)]
        fn $name() {
            let fields = [
                $($crate::layout::Field {
                    name: stringify!($field),
                    offset: std::mem::offset_of!($name, $field),
                    size: size_of::<$type>(),
                }),*
            ];
            $crate::layout::check($shader, stringify!($name), &fields, size_of::<$name>());
        }
    )*};
}
pub(crate) use gpu_struct;

/// Checks a struct against the struct of that name in a shader.
#[cfg(test)]
pub fn check(shader: &str, name: &str, fields: &[Field], size: usize) {
    let usual = crate::shader::usual();
    let (_, source) = usual.iter().find(|(s, _)| *s == shader).expect("a shader");
    let module = wgpu::naga::front::wgsl::parse_str(source).expect("valid WGSL");
    let mut layouter = wgpu::naga::proc::Layouter::default();
    layouter.update(module.to_ctx()).expect("sized types");
    let (_, found) = module
        .types
        .iter()
        .find(|(_, t)| t.name.as_deref() == Some(name))
        .unwrap_or_else(|| panic!("no struct {name}"));
    let wgpu::naga::TypeInner::Struct { members, span } = &found.inner else {
        panic!("{name} is no struct");
    };
    assert_eq!(*span as usize, size, "size of {name}");
    assert_eq!(members.len(), fields.len(), "fields of {name}");
    for (member, field) in members.iter().zip(fields) {
        assert_eq!(member.name.as_deref(), Some(field.name), "{name}");
        let found = (member.offset as usize, layouter[member.ty].size as usize);
        assert_eq!(found, (field.offset, field.size), "{name}.{}", field.name);
    }
}
