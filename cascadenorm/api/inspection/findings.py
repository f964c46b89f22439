"""Descriptions of the possible findings of an inspection."""

FINDINGS = {
    "bad_indices": ("face references a vertex that does not exist", "faces reference vertices that do not exist"),
    "not_finite": ("vertex is not finite", "vertices are not finite"),
    "repeated_corners": ("face repeats a vertex", "faces repeat a vertex"),
    "non_manifold_edges": ("edge has more than two faces", "edges have more than two faces"),
    "non_manifold_vertices": (
        "vertex is non-manifold, its faces not all connected by edges there",
        "vertices are non-manifold, their faces not all connected by edges there",
    ),
    "flipped_edges": (
        "edge has two faces of inconsistent orientation, one of them flipped",
        "edges have two faces of inconsistent orientation, one of them flipped",
    ),
    "inside_out": ("closed component is inside out, or a cavity", "closed components are inside out, or cavities"),
    "zero_area": ("face has no area", "faces have no area"),
    "slivers": (
        "face is a sliver, its height below 1 % of its longest edge",
        "faces are slivers, their heights below 1 % of their longest edges",
    ),
    "duplicate_faces": ("face duplicates an earlier one", "faces duplicate an earlier one"),
    "unreferenced": ("vertex is unreferenced", "vertices are unreferenced"),
    "duplicate_vertices": (
        "vertex coincides with an earlier one, but is not merged with it",
        "vertices coincide with an earlier one, but are not merged with it",
    ),
    "nearly_coincident": (
        "boundary vertex nearly coincides with an earlier one, but is not merged with it (denoise --weld joins them)",
        "boundary vertices nearly coincide with earlier ones, but are not merged with them (denoise --weld joins them)",
    ),
    "crossing_faces": ("face intersects others", "faces intersect others"),
    "spikes": ("vertex is a spike", "vertices are spikes"),
    "outliers": (
        "vertex is an outlier, far off the surface around it, which auto moves back",
        "vertices are outliers, far off the surface around them, which auto moves back",
    ),
    "small_components": (
        "small component, of less than 1 % of the faces of the largest (denoise --drop-components leaves it out)",
        "small components, of less than 1 % of the faces of the largest (denoise --drop-components leaves them out)",
    ),
}
"""Text that follows the count of each finding, in singular and plural."""
