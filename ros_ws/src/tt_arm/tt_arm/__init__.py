"""Joint motion of the PA10 that brings the racket to its state (dissertation Section 4.5, Appendix B)."""
