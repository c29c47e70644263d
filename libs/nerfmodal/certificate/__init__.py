"""The certificate of a rig: what it can see of motions that are known, before anything real is filmed with it."""

from nerfmodal.certificate.certify import Settings, certify
from nerfmodal.certificate.document import certificate_document, rig_digest
from nerfmodal.certificate.target import Board, board_before, moved

__all__ = ["Board", "Settings", "board_before", "certificate_document", "certify", "moved", "rig_digest"]
