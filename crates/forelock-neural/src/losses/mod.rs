//! The energies that the network is trained with.
