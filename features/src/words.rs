//! A text encoder: words to vectors, by the tokens of CLIP.

use std::{collections::BTreeMap, path::Path};

use cosplat_semantics::query::{Words, unit};
use instant_clip_tokenizer::{Token, Tokenizer};

use crate::{
    FeaturesError,
    config::{Config, TextConfig},
    network::{Network, Worker},
};

/// A text encoder.
pub struct TextEncoder {
    config: TextConfig,
    network: Network,
    tokenizer: Tokenizer,
}

impl TextEncoder {
    /// Loads the encoder of a TOML file.
    ///
    /// # Errors
    /// When the file is of another kind, or its network cannot be loaded.
    pub fn load(path: &Path) -> Result<Self, FeaturesError> {
        let config = match Config::read(path)? {
            Config::Text(config) => config,
            other => {
                let why = format!("kind is {:?}, expected \"text\"", other.kind());
                return Err(FeaturesError::config(path, why));
            }
        };
        let input = config.input.as_deref();
        let network = Network::load(path, &config.network, input, &[&config.output])?;
        Ok(Self {
            config,
            network,
            tokenizer: Tokenizer::new(),
        })
    }

    /// Tokens of a text between those of its start and its end; 0 after that.
    ///
    /// # Errors
    /// When they are more than the network takes.
    pub fn tokens(&self, text: &str) -> Result<Vec<i32>, FeaturesError> {
        let mut tokens = vec![self.tokenizer.start_of_text()];
        self.tokenizer.encode(text, &mut tokens);
        tokens.push(self.tokenizer.end_of_text());
        let most = self.config.tokens;
        if tokens.len() > most {
            return Err(FeaturesError::TooLong {
                text: text.to_owned(),
                tokens: tokens.len(),
                most,
            });
        }
        let mut found: Vec<i32> = tokens
            .into_iter()
            .map(Token::to_u16)
            .map(i32::from)
            .collect();
        found.resize(most, 0);
        Ok(found)
    }

    /// A unit vector for each word; `{}` in `prompt` stands for the word.
    ///
    /// # Errors
    /// When a text is too long, or the network does not run or gives another shape.
    pub fn words(&self, words: &[String], prompt: &str) -> Result<Words, FeaturesError> {
        let worker = Worker::default();
        let mut vector = BTreeMap::new();
        let mut dim = 0;
        for word in words {
            let tokens = self.tokens(&prompt.replace("{}", word))?;
            let input = self.network.whole(&[1, self.config.tokens], tokens)?;
            let found = self.network.run(&worker, input)?.swap_remove(0);
            let of = match found.shape.as_slice() {
                [1, of] if dim == 0 || dim == *of => *of,
                shape => {
                    let why = format!("has shape {shape:?}, expected [1, values]");
                    return Err(self.network.first(why));
                }
            };
            dim = of;
            let one = unit(&found.value);
            let one = one.ok_or_else(|| self.network.first(format!("is 0 for {word:?}")))?;
            vector.insert(word.clone(), one);
        }
        Ok(Words { dim, vector })
    }
}
