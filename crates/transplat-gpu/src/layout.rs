//! Structs that cross to the GPU: declared once, and checked against the WGSL by name, offset and size.

/// A field of a struct: name, offset and size in bytes.
#[cfg(test)]
pub struct Field {
    pub name: &'static str,
    pub offset: usize,
    pub size: usize,
}

/// Declares a plain struct with its layout as `FIELDS`.
macro_rules! gpu_struct {
    ($(#[$meta:meta])* struct $name:ident { $($field:ident: $type:ty),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        struct $name {
            $($field: $type),*
        }

        impl $name {
            #[cfg(test)]
            const FIELDS: &'static [$crate::layout::Field] = &[
                $($crate::layout::Field {
                    name: stringify!($field),
                    offset: std::mem::offset_of!($name, $field),
                    size: size_of::<$type>(),
                }),*
            ];
        }
    };
}
pub(crate) use gpu_struct;

/// Checks a struct against the struct of that name in a WGSL source.
#[cfg(test)]
pub fn check(source: &str, name: &str, fields: &[Field], size: usize) {
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
        assert_eq!(
            member.offset as usize, field.offset,
            "offset of {name}.{}",
            field.name
        );
        let member_size = layouter[member.ty].size as usize;
        assert_eq!(member_size, field.size, "size of {name}.{}", field.name);
    }
}
