"""Results and meshes of finite element programs: modes at nodes, and the nodes with their surface."""
