"""FrfSet -> PoleTable -> ModalModel."""
